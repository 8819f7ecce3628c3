"""Other Python threads run while one waits, and threads share objects safely."""

import numpy as np
import oracle
import pairmask
import pytest
from conftest import UNIT, Daemon, count_while, in_threads


def test_other_threads_run_while_a_frame_is_culled() -> None:
    boxes = oracle.boxes_of(20_000, 1)
    with pairmask.Session("in-process", engine="cpu-brute", threads=1) as session:
        frame = session.frame(len(boxes))
        frame.write(boxes)
        counted, took = count_while(frame.submit)
    # With the lock held, the other thread would not run once.
    assert counted > 100, (counted, took)


def test_other_threads_run_while_one_waits_for_a_tick(daemon: Daemon) -> None:
    with daemon.session() as session, daemon.session() as other:
        scene = session.join_scene("wait", tick_deadline=0.3)
        scene.lease_any(1)
        other.join_scene("wait").lease_any(1)
        with other.join_scene("wait") as late:
            late.lease_any(1)
            counted, took = count_while(scene.edit().set(0, UNIT).commit)
            assert took > 0.25 and counted > 1000, (counted, took)
            pending = scene.edit().set(0, UNIT).submit()
            ended: list[object] = []
            counted, took = count_while(lambda: ended.extend(in_threads(2, lambda _: pending.wait().tick)))
    # An answer is for one of two threads that wait for it.
    assert sorted(map(str, ended)) == ["2", "Closed"] and counted > 1000, (ended, counted)


def test_two_threads_cannot_wait_for_one_frame(daemon: Daemon) -> None:
    boxes = oracle.boxes_of(30_000, 1)
    with daemon.session() as session:
        frame = session.frame(len(boxes))
        frame.write(boxes)
        pending = frame.submit()
        answers = in_threads(2, lambda _: pending.wait().count)
    assert "Closed" in answers and any(isinstance(answer, int) for answer in answers)


@pytest.mark.parametrize("backend", ["in-process", "auto", "daemon"])
def test_threads_share_a_session_and_a_scene(daemon: Daemon, backend: str) -> None:
    scenes = [(boxes, oracle.pairs_of(boxes)) for boxes in (oracle.boxes_of(n, n) for n in (50, 345, 1000))]
    boxes, expected = scenes[0]
    with daemon.session(backend) as session:
        scene = session.scene()
        scene.edit().set(range(50), boxes).commit("nothing")

        def work(seed: int) -> int:
            """Culls, commits and submits. Returns how many answers of edits it waited for."""
            random = np.random.default_rng(seed)
            answered = 0
            for _ in range(60):
                some, pairs = scenes[random.integers(3)]
                oracle.check(session.cull(some), pairs)
                try:
                    if random.random() < 0.3:
                        oracle.check(scene.edit().set(range(50), boxes).commit("all").pairs, expected)
                    with scene.edit().set(range(50), boxes).submit("all") as pending:
                        if random.random() < 0.7:
                            oracle.check(pending.wait().pairs, expected)
                            answered += 1
                except pairmask.PairmaskError as error:
                    # The other threads may hold all slots for frames.
                    assert error.kind in ("UnderWay", "TooManyFrames"), error
            return answered

        assert sum(in_threads(8, work)) > 20
        oracle.check(scene.edit().commit("all").pairs, expected)
