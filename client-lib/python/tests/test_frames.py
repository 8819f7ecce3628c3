"""Frames: numpy in, numpy out."""

from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import Daemon
from pairmask import Precision

ENGINES: list[Any] = ["auto", "cpu-brute", "cpu-sap", "cpu-grid", "cpu-tree"]
ENCODINGS: list[Any] = ["auto", "dense", "sparse", "list"]


def lattice(n: int, _seed: int) -> Any:
    """Boxes that touch their neighbours in all directions."""
    side = max(1, round(max(n, 1) ** (1 / 3)))
    at = np.arange(n)
    low = np.stack([at % side, at // side % side, at // side**2], axis=1)
    return np.hstack([low, low + 1]).astype(np.float32)


def few_numbers(n: int, seed: int) -> Any:
    """Coordinates from few numbers, so that boxes touch, coincide, are empty, invalid and infinite."""
    numbers = np.array([-np.inf, -2, -1, -0.0, 0.0, 1e-45, 1, 2, np.inf, np.nan], np.float32)
    random = np.random.default_rng(seed)
    weights = np.array([1, 4, 4, 4, 4, 2, 4, 4, 1, 0.3])
    return random.choice(numbers, (n, 6), p=weights / weights.sum())


SCENES = pytest.mark.parametrize("scene", [oracle.boxes_of, lattice, few_numbers])


def answer_of(session: pairmask.Session, boxes: Any, **options: Any) -> pairmask.PairMask:
    frame = session.frame(len(boxes))
    frame.write(boxes)
    return frame.submit(**options).wait()


@SCENES
@pytest.mark.parametrize("threads", [1, 2])
def test_every_size_engine_and_encoding_has_the_pairs_of_the_oracle(scene: Any, threads: int) -> None:
    for engine, encoding in [(engine, "auto") for engine in ENGINES] + [("auto", of) for of in ENCODINGS[1:]]:
        with pairmask.Session("in-process", engine=engine, encoding=encoding, threads=threads) as session:
            for n in [*range(0, 71, 1 if engine == "auto" else 7), 345, 1234]:
                boxes = scene(n, n)
                oracle.check(session.cull(boxes), oracle.pairs_of(boxes), (engine, encoding, n))


@SCENES
def test_a_daemon_finds_the_same_pairs_in_its_memory(daemon: Daemon, scene: Any) -> None:
    with daemon.session() as session:
        for n in (0, 1, 2, 70, 345, 1234):
            boxes = scene(n, n)
            expected = oracle.pairs_of(boxes)
            oracle.check(session.cull(boxes), expected, n)
            frame = session.frame(n)
            assert frame.is_shared
            frame.boxes[:] = boxes
            with frame.submit().wait() as mask:
                oracle.check(mask.pairs(), expected, n)
                assert mask.info.served_by == "daemon"
        oracle.check(session.cull_spheres(np.array([[0, 0, 0, 1], [2, 0, 0, 1]], np.float32)), {(0, 1)})
        assert session.served_by() == "daemon" and session.daemon_status()["frames"] > 0


def test_a_frame_is_written_in_place_and_waited_for(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(345, 1)
    expected = oracle.pairs_of(boxes)
    frame = session.frame(345)
    assert (frame.n, frame.is_shared, repr(frame)) == (345, False, "<Frame (345, 6)>")
    frame.boxes[:] = boxes
    assert np.array_equal(frame.boxes, boxes)
    with frame.submit().wait() as mask:
        oracle.check(mask.pairs(), expected)
        assert (mask.n, mask.count, len(mask), len(list(mask))) == (345, *[len(expected)] * 3)
        a, b = min(expected)
        assert (a, b) in mask and (b, a) in mask and (a, a) not in mask
        assert mask.info.served_by == "in-process" and mask.info.engine.startswith("cpu-")
        assert mask.encoding in ENCODINGS
    mask = answer_of(session, boxes[:0])
    assert repr(mask).startswith("PairMask(0 boxes, 0 pairs") and list(mask) == []


def test_answers_can_only_be_read(session: pairmask.Session) -> None:
    scene = session.scene()
    scene.edit().set([0, 1], lattice(2, 0)).commit()
    answer = scene.edit().remove(1).commit()
    for array in (session.cull(lattice(8, 0)), answer.ended, answer.ended_reasons):
        assert not array.flags.writeable and array.flags.c_contiguous
        with pytest.raises(ValueError):
            array[0] = 7
        with pytest.raises(ValueError):
            array.flags.writeable = True


def test_any_layout_is_accepted(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(100, 2)
    expected = oracle.pairs_of(boxes)
    strided = np.zeros((200, 12), np.float32)
    strided[::2, ::2] = boxes
    unaligned = np.frombuffer(b"." + boxes.tobytes(), np.uint8)[1:].view(np.float32).reshape(-1, 6)
    layouts = [
        unaligned,
        boxes.tolist(),
        boxes.reshape(-1, 2, 3),
        boxes.reshape(-1, 2, 3).astype(np.float64).tolist(),
        np.asfortranarray(boxes),
        boxes.astype(">f4"),
        strided[::2, ::2],
        boxes.astype(np.float64),
        np.frombuffer(boxes.tobytes(), np.float32).reshape(-1, 6),
    ]
    for given in layouts:
        oracle.check(session.cull(given), expected)
        oracle.check(answer_of(session, given).pairs(), expected)
    integers = np.array([[0, 0, 0, 1, 1, 1], [1, 1, 1, 2, 2, 2]])
    for dtype in ("int8", "uint16", "int64", "float16"):
        assert session.cull(integers.astype(dtype)).tolist() == [[0, 1]]


def test_boxes_of_float64_are_rounded_outward(session: pairmask.Session) -> None:
    # The gap is smaller than a step of float32: rounded to nearest, faces of some boxes would part that touch.
    random = np.random.default_rng(3)
    edges = random.random((500, 3)) + 1
    boxes = np.empty((1000, 6))
    boxes[0::2] = np.hstack([edges - 1, edges])
    boxes[1::2] = np.hstack([edges, edges + 1])
    assert oracle.pairs_of(boxes) <= oracle.as_set(session.cull(boxes))
    narrow = pairmask.outward_from_f64(boxes)
    assert narrow.dtype == np.float32 and narrow.flags.writeable
    assert (narrow[:, :3] <= boxes[:, :3]).all() and (narrow[:, 3:] >= boxes[:, 3:]).all()
    moved = pairmask.outward_from_f64(narrow - np.tile([1, 0, 0], 2))
    assert np.array_equal(pairmask.outward_from_f64(narrow, (1, 0, 0)), moved)
    origin = (1e9, -1e9, 5e8)
    far = boxes + np.tile(origin, 2)
    assert oracle.pairs_of(far) <= oracle.as_set(session.cull(pairmask.outward_from_f64(far, origin)))


def test_two_sets(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(500, 4)
    found = answer_of(session, boxes, split_at=20).pairs()
    oracle.check(found, {(a, b) for a, b in oracle.pairs_of(boxes) if a < 20 <= b})


def test_spheres(session: pairmask.Session) -> None:
    random = np.random.default_rng(5)
    spheres = random.integers(0, 12, (300, 4)).astype(np.float32)
    spheres[:, 3] = random.integers(0, 3, 300)
    expected = oracle.sphere_pairs_of(spheres)
    assert len(expected) > 100
    frame, written = session.sphere_frame(300), session.sphere_frame(300)
    frame.spheres[:] = spheres
    written.write(spheres)
    for one in (frame, written):
        oracle.check(one.submit().wait().pairs(), expected)
    oracle.check(session.cull_spheres(spheres), expected)
    oracle.check(session.cull_spheres(spheres.astype(np.float64)), expected)
    # Touching in float64: rounded to nearest they would part.
    thirds = np.array([[1 / 3, 0, 0, 1 / 3], [1, 0, 0, 1 / 3]])
    assert session.cull_spheres(thirds).tolist() == [[0, 1]]


def test_narrow_frames_miss_nothing(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(1000, 6)
    expected = oracle.pairs_of(boxes)
    for precision, form in [
        (Precision.exact(), "f32"),
        (Precision.f16(), "f16"),
        (Precision.q16([0, 0, 0, 12, 12, 12]), "q16"),
        (Precision.q16(boxes), "q16"),
        (Precision.q8(boxes), "q8"),
    ]:
        frame = session.narrow_frame(1000, precision)
        frame.write(boxes)
        mask = frame.submit().wait()
        found = oracle.as_set(mask.pairs())
        assert expected <= found and len(found) < 3 * len(expected), precision
        assert found == expected or precision != Precision.exact()
        assert mask.info.form == form


def test_a_repeated_frame_is_reported(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(2000, 7)
    repeats = [answer_of(session, boxes).info.is_repeat for _ in range(3)]
    assert repeats[0] is False and repeats[-1] is True


def test_the_census_counts(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(50, 8)
    boxes[7, 2] = np.nan
    boxes[9, 3] = -1
    info = answer_of(session, boxes).info
    assert (info.invalid, info.empty, info.first_invalid) == (1, 1, [7])
    assert info.box_bytes == 50 * 24 and "invalid=1" in repr(info)
    with pytest.warns(RuntimeWarning, match="1 boxes or spheres are invalid and overlap nothing: 7 first"):
        session.cull(boxes)
