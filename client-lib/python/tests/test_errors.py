"""What is wrong is reported: the library's errors by class and kind, wrong arrays by ValueError and TypeError."""

import pickle
from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import UNIT, Daemon, kind_of, run_python


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


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"backend": "gpu"}, ValueError),
        ({"engine": "fast"}, ValueError),
        ({"encoding": "zip"}, ValueError),
        ({"isa": "fast"}, ValueError),
        ({"spin": -1}, ValueError),
        ({"spin": float("nan")}, ValueError),
        ({"deadline": -0.5}, ValueError),
        ({"engines": "auto"}, TypeError),
        ({"instance": "../x"}, pairmask.ConnectError),
    ],
)
def test_options_are_checked(options: dict[str, Any], error: type[Exception]) -> None:
    with pytest.raises(error):
        pairmask.Session(**{"backend": "in-process", **options})


def test_all_options_are_accepted() -> None:
    pairmask.Session(
        "in-process", deadline=float("inf"), spin=0, threads=1, iterate_threads=1, isa="portable", capacity=9
    ).close()


def test_a_session_has_three_frames(daemon: Daemon) -> None:
    with daemon.session() as session:
        frames = [session.frame(10) for _ in range(3)]
        frames[0].boxes[:] = 0
        mask = frames.pop(0).submit().wait()
        pairs = mask.pairs()
        assert kind_of(lambda: session.frame(10), "three frames") == "TooManyFrames"
        mask.release()
        session.frame(10)
        assert kind_of(mask.pairs, "released") == "Closed"
        assert len(pairs) == 45 == mask.count


@pytest.mark.parametrize("n", [2**32, 2**40, 2**63])
def test_too_many_boxes(session: pairmask.Session, n: int) -> None:
    assert kind_of(lambda: session.frame(n)) == "TooManyBoxes"
    with pytest.raises(OverflowError):
        session.frame(-1)
    with pytest.raises(TypeError):
        session.frame(1.5)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "error", "text"),
    [
        (np.zeros((3, 5), np.float32), ValueError, r"\(3, 5\): give \(n, 6\)"),
        (np.zeros(5, np.float32), ValueError, r"\(5,\)"),
        (np.zeros((1, 3, 6), np.float32), ValueError, r"\(1, 3, 6\)"),
        (np.zeros((2, 6), np.complex64), TypeError, "complex64"),
        (np.zeros((2, 6), bool), TypeError, "bool"),
        (np.zeros((2, 6), np.longdouble), TypeError, "float64"),
        (np.full((2, 6), 2**60), ValueError, "2..53"),
        (np.full((2, 6), -(2**60)), ValueError, "2..53"),
        (np.ma.masked_array(np.zeros((4, 6)), mask=np.zeros((4, 6), bool)), TypeError, "masked"),
        ([["a"] * 6], TypeError, None),
        ([[None] * 6], TypeError, None),
        (None, ValueError, None),
        (7, ValueError, None),
        ("boxes", ValueError, None),
        ([[0, 0], [0]], ValueError, None),
    ],
)
def test_wrong_arrays(session: pairmask.Session, given: Any, error: type[Exception], text: str | None) -> None:
    for use in (session.cull, session.frame(2).write, lambda boxes: session.scene().edit().set(range(2), boxes)):
        with pytest.raises(error, match=text):
            use(given)


def test_as_many_boxes_as_the_frame_has(session: pairmask.Session) -> None:
    for n in (0, 2, 4):
        for frame in (session.frame(3), session.narrow_frame(3, pairmask.Precision.f16())):
            with pytest.raises(ValueError, match=f"{n} rows for 3 boxes"):
                frame.write(np.zeros((n, 6), np.float32))
    with pytest.raises(ValueError):
        session.sphere_frame(3).write(np.zeros((2, 4), np.float32))
    assert kind_of(lambda: session.frame(3).submit(split_at=4)) == "FirstSet"
    for frame in (session.sphere_frame(3), session.narrow_frame(3, pairmask.Precision.f16())):
        with pytest.raises(AttributeError):
            frame.boxes


def test_what_is_used_up_says_so(session: pairmask.Session) -> None:
    frame, scene = session.frame(2), session.scene()
    frame.write(oracle.boxes_of(2, 1))
    scene.edit().set(3, UNIT).commit("nothing")
    assert repr(session) == "<Session, in-process>" and repr(scene) == "<Scene of 1 boxes>"
    pending = frame.submit()
    submitted: list[Any] = [frame.submit, lambda: frame.boxes, lambda: frame.write(oracle.boxes_of(2, 1))]
    for use in submitted:
        assert kind_of(use, "submitted") == "Closed"
    assert pending.try_receive() is not None
    assert kind_of(pending.try_receive) == "AlreadyReceived"
    with pytest.raises(pairmask.PairmaskError):
        pending.wait(timeout=0.1)
    for timeout in (-1.0, float("nan")):
        with pytest.raises(ValueError, match="seconds"):
            pending.wait(timeout)
    assert kind_of(lambda: session.join_scene("a")) == "NeedsDaemon"
    session.close()
    assert kind_of(lambda: session.frame(1), "the session was closed") == "Closed"
    assert kind_of(lambda: scene.edit().set(3, UNIT).commit("nothing"), "the scene was closed") == "Closed"
    assert repr(scene) == "<Scene, closed or being edited>" and repr(session) == "<Session, closed>"
    session.close()


def test_no_time_is_a_timeout(daemon: Daemon) -> None:
    with daemon.session() as session:
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


def test_gpu_engines_are_not_here() -> None:
    with pairmask.Session("in-process", engine="gpu-grid") as forced:
        assert kind_of(lambda: forced.cull([UNIT])) == "Cull"


def test_no_memory_is_an_error_and_no_abort() -> None:
    printed = run_python(
        "-c",
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
    assert printed.splitlines() == ["this process has no memory for 1073741824 boxes or spheres"] * 3


def test_a_fork_is_an_error_and_no_hang(daemon: Daemon) -> None:
    printed = run_python(
        "-c",
        """
import os, sys, numpy as np, pairmask
session = pairmask.Session("daemon", runtime_dir=sys.argv[1])
boxes = np.zeros((3000, 6), np.float32)
session.cull(boxes)
frame, scene, edited = session.frame(3000), session.scene(), session.scene()
frame.write(boxes)
pending, answer = session.frame(10).submit(), edited.edit().set(range(100), boxes[:100]).submit("all")
child = os.fork()
if child == 0:
    uses = [lambda: session.frame(1), lambda: session.cull(boxes), pairmask.Session, scene.edit().commit, frame.submit]
    uses += [pending.wait, scene.close, answer.wait, edited.edit().submit, lambda: pairmask.placed(boxes, boxes[:, :3])]
    kinds = []
    for use in uses:
        try:
            use()
        except pairmask.PairmaskError as error:
            kinds.append(error.kind)
    answer.close()
    # Drops everything, as the end of a program does.
    del session, frame, scene, edited, pending, answer, uses, use
    sys.exit(0 if kinds == ["Forked"] * 10 else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
# Nothing of this process was taken away.
assert frame.submit().wait().count == 3000 * 2999 // 2
pending.wait().release()
assert len(answer.wait().pairs) == 100 * 99 // 2
assert len(session.cull(boxes)) == 3000 * 2999 // 2 and session.served_by() == "daemon"
""",
        daemon.folder,
    )
    assert printed.strip() == "0"
