"""Edits under way: submitted, waited for, given up, and scenes that they borrow."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import Daemon, run_python, wait_by_two_threads

BACKENDS = pytest.mark.parametrize("backend", ["in-process", "auto", "daemon"])


def kind_of(call: Callable[[], object]) -> str:
    with pytest.raises(pairmask.PairmaskError) as caught:
        call()
    return caught.value.kind


def scenes_of(session: pairmask.Session) -> list[Any]:
    """A scene without margins and two with some, and the arguments that its boxes have beside."""
    return [(session.scene(), []), (session.scene(margins="exact"), [0.1]), (session.scene(margins="near"), [0.0])]


@BACKENDS
def test_edits_are_answered_when_they_are_waited_for(daemon: Daemon, backend: str) -> None:
    with daemon.session(backend) as session:
        for scene, margin in scenes_of(session):
            told: oracle.Pairs = set()
            for step in range(6):
                boxes = oracle.boxes_of(200, step)
                expected = oracle.pairs_of(boxes)
                with scene.edit().set(range(200), boxes, *margin).submit() as pending:
                    answer = pending.wait()
                if answer.is_resync:
                    oracle.check(answer.pairs, expected, step)
                else:
                    oracle.check(answer.begun, expected - told, step)
                    oracle.check(answer.ended, told - expected, step)
                told = expected
                assert answer.served_by == ("in-process" if backend == "in-process" else "daemon")
            box = scene.get(7)
            assert box is not None and np.array_equal(box, oracle.boxes_of(200, 5)[7])


@BACKENDS
def test_a_scene_is_left_alone_while_its_edit_is_under_way(daemon: Daemon, backend: str) -> None:
    with daemon.session(backend) as session:
        boxes = oracle.boxes_of(100, 1)
        for scene, margin in scenes_of(session):
            next_edit = scene.edit().set(range(50), boxes[50:], *margin)
            pending = scene.edit().set(range(100), boxes, *margin).submit("all")
            uses: list[Callable[[], object]] = [
                next_edit.commit,
                next_edit.submit,
                scene.resync,
                lambda: len(scene),
                lambda: scene.get(0),
                lambda: scene.allocated_bytes,
            ]
            assert [kind_of(use) for use in uses] == ["UnderWay"] * len(uses)
            oracle.check(pending.wait().pairs, oracle.pairs_of(boxes))
            assert [kind_of(pending.wait) for _ in range(2)] == ["Gone"] * 2
            # The edit was not lost.
            both = np.vstack([boxes[50:], boxes[50:]])
            oracle.check(next_edit.commit("all").pairs, oracle.pairs_of(both))
            assert kind_of(pending.wait) == kind_of(next_edit.submit) == "Gone"


@BACKENDS
@pytest.mark.parametrize("way", ["dropped", "closed", "left"])
def test_an_answer_that_is_given_up_is_told_again(daemon: Daemon, backend: str, way: str) -> None:
    with daemon.session(backend) as session:
        boxes = oracle.boxes_of(300, 2)
        for scene, margin in scenes_of(session):
            # More edits than the session has places for frames.
            for step in range(8):
                edit = scene.edit().set(range(300), oracle.boxes_of(300, 2 + step % 2), *margin)
                pending = edit.submit()
                if way == "closed":
                    pending.close()
                    pending.close()
                    assert kind_of(pending.wait) == "Gone"
                elif way == "left":
                    with pending:
                        pass
                del pending
            scene.edit().set(range(300), boxes, *margin).submit().close()
            assert len(scene) == 300
            answer = scene.edit().commit()
            oracle.check(answer.pairs if answer.is_resync else answer.begun, oracle.pairs_of(boxes))
            assert len(scene.edit().commit().begun) == 0
        oracle.check(session.cull(boxes), oracle.pairs_of(boxes))


def test_an_edit_keeps_its_scene_and_is_dropped_with_it(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(100, 3)
    scene = session.scene()
    pending = scene.edit().set(range(100), boxes).submit()
    del scene
    gc.collect()
    answer = pending.wait()
    del pending
    session.close()
    gc.collect()
    # Arrays outlive scenes, edits and sessions.
    oracle.check(answer.begun, oracle.pairs_of(boxes))


@BACKENDS
def test_a_scene_that_is_closed_ends_its_edit(daemon: Daemon, backend: str) -> None:
    with daemon.session(backend) as session:
        for scene, margin in scenes_of(session):
            with scene:
                pending = scene.edit().set(range(3), oracle.boxes_of(3, 1), *margin).submit()
            assert kind_of(pending.wait) == kind_of(scene.edit().submit) == "Gone"
            pending.close()
            del pending
        assert session.served_by() == ("in-process" if backend == "in-process" else "daemon")


def test_what_is_wrong_with_submitted_edits(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(3, 4)
    for scene, margin in scenes_of(session):
        scene.edit().set(range(3), boxes, *margin).commit()
        with pytest.raises(pairmask.PairmaskError, match="has no box") as caught:
            scene.edit().remove(9).submit()
        assert caught.value.kind == "Edit"
        with pytest.raises(ValueError, match="changes, moved, all or nothing"):
            scene.edit().submit("some")
        # The scene is what it was, and no edit of it is under way.
        oracle.check(scene.edit().submit("all").wait().pairs, oracle.pairs_of(boxes))


def test_a_daemon_that_dies_while_an_edit_is_under_way(daemon: Daemon) -> None:
    boxes = oracle.boxes_of(500, 5)
    with daemon.session("auto") as session, daemon.session("daemon", deadline=5) as insists:
        scene, other = session.scene(), insists.scene()
        for one in (scene, other):
            assert one.edit().set(range(500), boxes).submit().wait().served_by == "daemon"
        boxes[3] = boxes[4]
        pending = [one.edit().set(3, boxes[4]).submit("all") for one in (scene, other)]
        daemon.kill()
        # The answer may have come before the daemon's end.
        oracle.check(pending[0].wait().pairs, oracle.pairs_of(boxes))
        try:
            oracle.check(pending[1].wait().pairs, oracle.pairs_of(boxes))
        except pairmask.PairmaskError as error:
            assert error.kind in ("DaemonDied", "NoDaemon")
        assert kind_of(pending[1].wait) == "Gone" and len(other) == 500
        answer = scene.edit().submit("all").wait()
        assert answer.served_by == "in-process"
        oracle.check(answer.pairs, oracle.pairs_of(boxes))


def test_a_tick_of_a_shared_scene_is_waited_for(daemon: Daemon) -> None:
    with daemon.session("daemon") as session, daemon.session("daemon") as other:
        scenes = [s.join_scene("pending", scope="all", tick_deadline=10) for s in (session, other)]
        boxes = oracle.boxes_of(40, 6)
        for at, scene in enumerate(scenes):
            scene.lease(range(20 * at, 20 * at + 20))
        # One thread commits for both: neither waits before the other has submitted.
        pending = [
            scene.edit().set(range(20 * at, 20 * at + 20), boxes[20 * at : 20 * at + 20]).submit("all")
            for at, scene in enumerate(scenes)
        ]
        assert kind_of(lambda: scenes[0].leases) == "UnderWay"
        answers = [one.wait() for one in pending]
        assert {answer.tick for answer in answers} == {1} and not any(answer.late for answer in answers)
        for answer in answers:
            oracle.check(answer.pairs, oracle.pairs_of(boxes))


def test_two_threads_cannot_wait_for_one_edit(daemon: Daemon) -> None:
    with daemon.session("daemon") as session, daemon.session("daemon") as other:
        scene = session.join_scene("threads", tick_deadline=0.3)
        scene.lease_any(1)
        late = other.join_scene("threads")
        late.lease_any(1)
        pending = scene.edit().set(0, [0, 0, 0, 1, 1, 1]).submit()
        counted = 0
        threads, ended = wait_by_two_threads(lambda: pending.wait().tick)
        while any(thread.is_alive() for thread in threads):
            counted += 1
        # Python's lock was left to this thread.
        assert sorted(map(str, ended)) == ["1", "Gone"] and counted > 1000


@BACKENDS
def test_threads_share_a_scene_with_edits_under_way(daemon: Daemon, backend: str) -> None:
    boxes = oracle.boxes_of(100, 8)
    expected = oracle.pairs_of(boxes)
    with daemon.session(backend) as session:
        scene = session.scene()
        scene.edit().set(range(100), boxes).commit("nothing")
        answered: list[int] = []
        wrong: list[object] = []

        def work(seed: int) -> None:
            random = np.random.default_rng(seed)
            for _ in range(150):
                try:
                    with scene.edit().set(range(100), boxes).submit("all") as pending:
                        if random.random() < 0.7:
                            oracle.check(pending.wait().pairs, expected)
                            answered.append(seed)
                except pairmask.PairmaskError as error:
                    if error.kind not in ("UnderWay", "TooManyFrames"):
                        wrong.append(error)
                except BaseException as error:  # noqa: BLE001
                    wrong.append(error)

        threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert not wrong and len(answered) > 20, (wrong[:3], len(answered))
        oracle.check(scene.edit().commit("all").pairs, expected)


def test_edits_are_freed(session: pairmask.Session) -> None:
    scene = session.scene()
    scene.edit().set(range(100), oracle.boxes_of(100, 7)).commit()
    before = scene.allocated_bytes
    for _ in range(1000):
        scene.edit().set(range(100), oracle.boxes_of(100, 7)).submit()
    assert len(scene) == 100 and scene.allocated_bytes < before + (1 << 20)


def test_a_fork_leaves_an_edit_to_its_process(daemon: Daemon) -> None:
    told = run_python(
        """
import os, sys, numpy as np, pairmask
session = pairmask.Session("daemon", runtime_dir=sys.argv[1])
scene = session.scene()
boxes = np.zeros((100, 6), np.float32)
source = pairmask.BoxSource.min_max(boxes[:, :3], boxes[:, 3:])
pending = scene.edit().set(range(100), boxes).submit("all")
child = os.fork()
if child == 0:
    kinds = []
    for use in (pending.wait, scene.edit().submit, source.boxes, lambda: session.cull(boxes)):
        try:
            use()
        except pairmask.PairmaskError as error:
            kinds.append(error.kind)
    pending.close()
    del pending, scene, session, use
    sys.exit(0 if kinds == ["Forked"] * 4 else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
assert len(pending.wait().pairs) == 100 * 99 // 2
""",
        str(daemon.folder),
    )
    assert told.strip() == "0"
