"""Other Python threads run while one waits, and threads share objects safely."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import oracle
import pairmask
from conftest import Daemon, wait_by_two_threads


def count_while(work: Any) -> tuple[int, float]:
    """How often a loop of Python ran on another thread while `work` did, and how long that took."""
    done = threading.Event()
    counted = 0

    def count() -> None:
        nonlocal counted
        while not done.is_set():
            counted += 1

    thread = threading.Thread(target=count)
    thread.start()
    began = time.perf_counter()
    work()
    took = time.perf_counter() - began
    done.set()
    thread.join()
    return counted, took


def test_other_threads_run_while_a_frame_is_culled() -> None:
    boxes = oracle.boxes_of(20_000, 1)
    with pairmask.Session("in-process", engine="cpu-brute", threads=1) as session:
        frame = session.frame(len(boxes))
        frame.write(boxes)
        counted, took = count_while(frame.submit)
    # With the lock held, the other thread would not run once.
    assert counted > 100, (counted, took)


def test_other_threads_run_while_one_waits_for_a_tick(daemon: Daemon) -> None:
    with daemon.session("daemon") as session, daemon.session("daemon") as other:
        scene = session.join_scene("wait", tick_deadline=0.3)
        scene.lease_any(1)
        other.join_scene("wait").lease_any(1)
        with other.join_scene("wait") as late:
            late.lease_any(1)
            counted, took = count_while(scene.edit().set(0, [0, 0, 0, 1, 1, 1]).commit)
    assert took > 0.25 and counted > 1000, (counted, took)


def test_threads_share_a_session_and_a_scene(daemon: Daemon) -> None:
    scenes = [oracle.boxes_of(n, n) for n in (50, 345, 1000)]
    expected = [oracle.pairs_of(boxes) for boxes in scenes]
    wrong: list[BaseException] = []

    for backend in ("in-process", "auto", "daemon"):
        session = daemon.session(backend)
        scene = session.scene()

        def work(seed: int, session: pairmask.Session = session, scene: pairmask.Scene = scene) -> None:
            try:
                for step in range(60):
                    at = (seed + step) % len(scenes)
                    oracle.check(session.cull(scenes[at]), expected[at])
                    try:
                        scene.edit().set(range(50 * seed, 50 * seed + 50), scenes[0]).commit()
                    except pairmask.PairmaskError as error:
                        # All places for frames may be taken by the other threads.
                        assert error.kind == "TooManyFrames", error
            except BaseException as error:  # noqa: BLE001
                wrong.append(error)

        threads = [threading.Thread(target=work, args=(seed,)) for seed in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert not wrong, wrong
        session.close()


def test_two_threads_cannot_wait_for_one_frame(daemon: Daemon) -> None:
    boxes = oracle.boxes_of(30_000, 1)
    with daemon.session("daemon") as session:
        frame = session.frame(len(boxes))
        frame.write(boxes)
        pending = frame.submit()
        threads, answers = wait_by_two_threads(lambda: pending.wait().count)
        for thread in threads:
            thread.join()
    assert "Gone" in answers and any(isinstance(answer, int) for answer in answers)


def test_scenes_of_numpy_are_not_torn(session: pairmask.Session) -> None:
    # The interpreter's lock is held while boxes are copied in.
    boxes = np.zeros((1000, 6), np.float32)
    counts = {len(session.cull(boxes)) for _ in range(5)}
    assert counts == {1000 * 999 // 2}
