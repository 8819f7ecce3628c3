"""Arrays outlive frames, masks, sessions and the daemon; a frame is not submitted under an array."""

import gc
import random
import resource
import sys
from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import Daemon


@pytest.mark.parametrize("backend", ["in-process", "daemon"])
def test_a_frame_is_neither_written_nor_submitted_under_an_array(daemon: Daemon, backend: str) -> None:
    boxes = oracle.boxes_of(100, 1)
    with daemon.session(backend) as session:
        frame = session.frame(100)
        array = frame.boxes
        part = array[10:20, ::2]
        array[:] = boxes
        kept = memoryview(frame.boxes)  # type: ignore[arg-type]
        for use in (frame.submit, lambda: frame.submit(split_at=1), lambda: frame.write(boxes)):
            with pytest.raises(BufferError, match="lie over this frame"):
                use()
        del array
        with pytest.raises(BufferError):
            frame.submit()
        del part
        kept.release()
        oracle.check(frame.submit().wait().pairs(), oracle.pairs_of(boxes))


def test_two_arrays_over_one_frame_are_the_same_memory(session: pairmask.Session) -> None:
    frame = session.frame(5)
    one, other = frame.boxes, frame.boxes
    one[:] = 7
    assert (other == 7).all() and np.shares_memory(one, other)
    assert one.shape == (5, 6) and one.dtype == np.float32 and one.flags.writeable
    del one, other
    for _ in range(1000):
        np.asarray(frame.boxes)[0]
    assert sys.getrefcount(frame) == 2
    frame.submit()


def test_arrays_outlive_frames_sessions_and_the_daemon(daemon: Daemon) -> None:
    boxes = oracle.boxes_of(3000, 2)
    session = daemon.session()
    frame = session.frame(3000)
    assert frame.is_shared
    written = frame.boxes
    written[:] = boxes
    pairs = session.cull(boxes)
    scene = session.scene()
    begun = scene.edit().set(range(3000), boxes).commit().begun
    del frame, scene
    session.close()
    del session
    gc.collect()
    assert np.array_equal(written, boxes)
    daemon.kill()
    gc.collect()
    written[5] = 9
    assert np.array_equal(np.delete(written, 5, 0), np.delete(boxes, 5, 0))
    expected = oracle.pairs_of(boxes)
    oracle.check(pairs, expected)
    oracle.check(begun, expected)


def resident() -> int:
    """Bytes of this process in memory, shared memory included."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def one_frame(session: pairmask.Session, boxes: Any, choose: random.Random, kept: list[Any]) -> Any:
    """A frame that may be given up at any step, and of which anything may be kept. Returns its pairs, if any."""

    def keeps(what: Any) -> bool:
        is_kept = choose.random() < 0.1
        kept.extend([what] * is_kept)
        return is_kept

    frame = session.frame(len(boxes))
    frame.boxes[:] = boxes
    keeps(frame.boxes)
    if keeps(frame):
        return None
    try:
        pending = frame.submit()
    except BufferError:
        return None
    if choose.random() < 0.05:
        return None
    mask = pending.wait()
    keeps(mask)
    return mask.pairs()


def storm(session: pairmask.Session, frames: int, seed: int, daemon: Daemon | None = None) -> int:
    """Frames with arrays kept and dropped at random, each answer checked. Returns how many were answered."""
    choose = random.Random(seed)
    scenes = [(boxes, oracle.pairs_of(boxes)) for boxes in (oracle.boxes_of(n, n) for n in (0, 3, 64, 345, 1000))]
    kept: list[Any] = []
    answered = 0
    for step in range(frames):
        if daemon is not None and step % 100 == 50:
            (daemon.kill if daemon.process else daemon.start)()
        boxes, expected = choose.choice(scenes)
        try:
            pairs = one_frame(session, boxes, choose, kept)
        except pairmask.PairmaskError as error:
            # What is kept holds the session's slots for frames.
            assert error.kind == "TooManyFrames"
            kept = [one for one in kept if isinstance(one, np.ndarray) and not one.flags.writeable]
            continue
        if pairs is not None:
            oracle.check(pairs, expected)
            answered += 1
            kept.append(pairs)
        if kept and choose.random() < 0.3:
            choose.shuffle(kept)
            del kept[choose.randrange(len(kept)) :]
    for one in kept:
        if isinstance(one, np.ndarray):
            one.sum()
    return answered


@pytest.mark.parametrize(("backend", "is_killed"), [("in-process", False), ("daemon", False), ("auto", True)])
def test_a_thousand_frames_with_arrays_kept_and_dropped(daemon: Daemon, backend: str, is_killed: bool) -> None:
    with daemon.session(backend) as session:
        storm(session, 300, 1, daemon if is_killed else None)
        gc.collect()
        before = resident()
        assert storm(session, 1000, 2, daemon if is_killed else None) > 300
        gc.collect()
        # Allocators keep some; a leak of every frame would be 24 MB.
        assert is_killed or resident() - before < 8 << 20
