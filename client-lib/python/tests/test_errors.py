"""What is wrong is told: the library's errors by class and kind, wrong arrays by ValueError and TypeError."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import Daemon, run_python


def test_a_session_without_a_daemon(tmp_path: Any) -> None:
    with pytest.raises(pairmask.ConnectError, match="no daemon serves instance 'none'") as caught:
        pairmask.Session("daemon", instance="none", runtime_dir=tmp_path)
    assert caught.value.kind == "NoDaemon"
    assert isinstance(caught.value, pairmask.PairmaskError)
    with pairmask.Session("auto", instance="none", runtime_dir=tmp_path) as session:
        assert session.served_by() == "in-process"
        with pytest.raises(pairmask.PairmaskError):
            session.daemon_status()
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (type(copy), str(copy), copy.kind) == (type(caught.value), str(caught.value), "NoDaemon")


def test_options_are_checked() -> None:
    wrong: list[dict[str, Any]] = [
        {"backend": "gpu"},
        {"engine": "fast"},
        {"encoding": "zip"},
        {"isa": "fast"},
        {"spin": -1},
        {"spin": float("nan")},
        {"deadline": -0.5},
    ]
    for options in wrong:
        with pytest.raises(ValueError):
            pairmask.Session(**{"backend": "in-process", **options})
    with pytest.raises(pairmask.ConnectError, match="name"):
        pairmask.Session("in-process", instance="../x")
    with pytest.raises(TypeError):
        pairmask.Session(engines="auto")  # type: ignore[call-arg]
    pairmask.Session("in-process", deadline=float("inf"), threads=1, visit_threads=1, isa="portable").close()


def test_a_session_has_three_frames(daemon: Daemon) -> None:
    with daemon.session("daemon") as session:
        frames = [session.frame(10) for _ in range(3)]
        with pytest.raises(pairmask.PairmaskError, match="three frames") as caught:
            session.frame(10)
        assert caught.value.kind == "TooManyFrames"
        frames[0].boxes[:] = 0
        mask = frames.pop(0).submit().wait()
        pairs = mask.pairs()
        with pytest.raises(pairmask.PairmaskError):
            session.frame(10)
        mask.release()
        session.frame(10)
        with pytest.raises(pairmask.PairmaskError, match="released"):
            mask.pairs()
        assert len(pairs) == 45 == mask.count


@pytest.mark.parametrize("n", [2**32, 2**40, 2**63])
def test_too_many_boxes(session: pairmask.Session, n: int) -> None:
    with pytest.raises(pairmask.PairmaskError) as caught:
        session.frame(n)
    assert caught.value.kind == "TooManyBoxes"
    with pytest.raises(OverflowError):
        session.frame(-1)
    with pytest.raises(TypeError):
        session.frame(1.5)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "error"),
    [
        (np.zeros((3, 5), np.float32), ValueError),
        (np.zeros(6, np.float32), ValueError),
        (np.zeros((1, 3, 6), np.float32), ValueError),
        (np.zeros((2, 6), np.complex64), TypeError),
        (np.zeros((2, 6), bool), TypeError),
        (np.zeros((2, 6), np.longdouble), TypeError),
        (np.full((2, 6), 2**60), ValueError),
        ([["a"] * 6], TypeError),
        ([[None] * 6], TypeError),
        (None, ValueError),
        (7, ValueError),
        ("boxes", ValueError),
        ([[0, 0], [0]], ValueError),
    ],
)
def test_wrong_arrays(session: pairmask.Session, given: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        session.cull(given)
    with pytest.raises(error):
        session.frame(2).write(given)
    with pytest.raises(error):
        session.scene().edit().set(range(2), np.zeros((1, 3, 6)) if np.shape(given) == (6,) else given)


def test_as_many_boxes_as_the_frame_has(session: pairmask.Session) -> None:
    for n in (0, 2, 4):
        for frame in (session.frame(3), session.narrow_frame(3, pairmask.Precision.f16())):
            with pytest.raises(ValueError, match="3 boxes"):
                frame.write(np.zeros((n, 6), np.float32))
    with pytest.raises(ValueError):
        session.sphere_frame(3).write(np.zeros((2, 4), np.float32))
    with pytest.raises(pairmask.PairmaskError) as caught:
        session.frame(3).submit(split_at=4)
    assert caught.value.kind == "FirstSet"


def test_what_is_used_up_says_so(session: pairmask.Session) -> None:
    frame = session.frame(2)
    frame.write(oracle.boxes_of(2, 1))
    pending = frame.submit()
    for use in (frame.submit, lambda: frame.boxes, lambda: frame.write(oracle.boxes_of(2, 1))):
        with pytest.raises(pairmask.PairmaskError, match="submitted"):
            use()
    assert pending.try_take() is not None
    with pytest.raises(pairmask.PairmaskError, match="taken already") as caught:
        pending.try_take()
    assert caught.value.kind == "Taken"
    with pytest.raises(pairmask.PairmaskError):
        pending.wait(timeout=0.1)
    for timeout in (-1.0, float("nan")):
        with pytest.raises(ValueError, match="seconds"):
            pending.wait(timeout)
    session.close()
    with pytest.raises(pairmask.PairmaskError, match="closed"):
        session.frame(1)
    session.close()


def test_no_time_is_a_timeout(daemon: Daemon) -> None:
    with daemon.session("daemon") as session:
        boxes = oracle.boxes_of(20_000, 1)
        for _ in range(200):
            frame = session.frame(len(boxes))
            boxes[0, 0] += 1
            frame.write(boxes)
            pending = frame.submit()
            try:
                pending.wait(timeout=0)
            except pairmask.WaitTimeout as error:
                assert isinstance(error, TimeoutError) and error.kind == "Timeout"
                assert pending.wait(timeout=30).n == len(boxes)
                return
    raise AssertionError("every answer was there at once")


def test_gpu_engines_are_not_here(session: pairmask.Session) -> None:
    with pairmask.Session("in-process", engine="gpu-grid") as insists:
        with pytest.raises(pairmask.PairmaskError) as caught:
            insists.cull(oracle.boxes_of(5, 1))
        assert caught.value.kind == "Cull"


def test_no_memory_is_an_error_and_no_abort() -> None:
    told = run_python(
        """
import resource, pairmask
session = pairmask.Session("in-process", threads=1)
resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
for begin in (session.frame, session.sphere_frame, lambda n: session.narrow_frame(n, pairmask.Precision.f16())):
    try:
        begin(2**30)
    except MemoryError as error:
        print(error)
"""
    )
    assert told.splitlines() == ["this process has no memory for 1073741824 boxes or spheres"] * 3


def test_a_fork_is_told_instead_of_hanging(daemon: Daemon) -> None:
    told = run_python(
        """
import os, sys, numpy as np, pairmask
session = pairmask.Session("daemon", runtime_dir=sys.argv[1])
boxes = np.zeros((3000, 6), np.float32)
session.cull(boxes)
frame, scene = session.frame(3000), session.scene()
frame.write(boxes)
pending = session.frame(10).submit()
child = os.fork()
if child == 0:
    kinds = []
    for use in (lambda: session.frame(1), pairmask.Session, scene.edit().commit, frame.submit, pending.wait, scene.close):
        try:
            use()
        except pairmask.PairmaskError as error:
            kinds.append(error.kind)
    # Drops everything, as the end of a program does.
    del session, frame, scene, pending, use
    sys.exit(0 if kinds == ["Forked"] * 6 else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
# Nothing of this process was taken away.
assert frame.submit().wait().count == 3000 * 2999 // 2
pending.wait().release()
assert len(session.cull(boxes)) == 3000 * 2999 // 2 and session.served_by() == "daemon"
""",
        str(daemon.folder),
    )
    assert told.strip() == "0"
