"""Boxes that are made while they are written, against the same in float64."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import Daemon
from pairmask import BoxSource


def rotations(quaternions: Any) -> Any:
    """The matrices of quaternions `x y z w` of unit length."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def corners(boxes: Any) -> Any:
    """The eight corners of each box, in float64."""
    ends = boxes.astype(np.float64).reshape(-1, 2, 3)
    choice = np.array([[at >> axis & 1 for axis in range(3)] for at in range(8)])
    return np.stack([ends[:, choice[:, axis], axis] for axis in range(3)], axis=2)


def check_around(got: Any, points: Any) -> None:
    """The boxes hold the points, and are no larger than float32 makes them."""
    low, high = points.min(axis=1), points.max(axis=1)
    assert got.dtype == np.float32 and got.shape == (len(points), 6)
    # The oracle's own rounding in float64.
    assert (got[:, :3] <= low + 1e-12).all() and (got[:, 3:] >= high - 1e-12).all()
    assert np.allclose(got, np.hstack([low, high]), rtol=1e-5, atol=1e-5)


def some(n: int, seed: int) -> tuple[Any, Any, Any, Any]:
    random = np.random.default_rng(seed)
    turned = random.normal(size=(n, 4))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    moved, scaled = random.uniform(-5, 5, (n, 3)), random.uniform(0.5, 2, (n, 3))
    boxes = oracle.boxes_of(n, seed, spread=0.1)
    return boxes, *(numbers.astype(np.float32) for numbers in (moved, turned, scaled))


def test_corners_and_centres() -> None:
    boxes = oracle.boxes_of(1000, 1)
    low, high = boxes[:, :3], boxes[:, 3:]
    assert np.array_equal(BoxSource.min_max(low, high).boxes(), boxes)
    center, half = ((high + low) / 2).astype(np.float32), ((high - low) / 2).astype(np.float32)
    source = BoxSource.center_half(center, half)
    assert np.array_equal(source.boxes(), np.hstack([center - half, center + half])) and len(source) == 1000
    # It has what it was made of.
    expected = source.boxes()
    center[:] = 0
    assert np.array_equal(source.boxes(), expected) and source.boxes().flags.writeable
    assert BoxSource.min_max(np.zeros((0, 3)), []).boxes().shape == (0, 6)


def test_transforms_hold_all_corners() -> None:
    boxes, moved, turned, scaled = some(2000, 2)
    points = corners(boxes)
    check_around(BoxSource.placed(boxes, moved).boxes(), points + moved[:, None].astype(np.float64))
    linear = rotations(turned.astype(np.float64))
    world = np.einsum("nij,nkj->nki", linear, points * scaled[:, None].astype(np.float64))
    world += moved[:, None].astype(np.float64)
    placed = BoxSource.placed(boxes, moved, turned, scaled)
    check_around(placed.boxes(), world)
    unscaled = np.einsum("nij,nkj->nki", linear, points) + moved[:, None].astype(np.float64)
    check_around(BoxSource.placed(boxes, moved, rotation=turned).boxes(), unscaled)
    matrices = np.concatenate([linear, moved[:, :, None]], axis=2).astype(np.float32)
    exact = matrices.astype(np.float64)
    by_matrix = np.einsum("nij,nkj->nki", exact[:, :, :3], points) + exact[:, None, :, 3]
    transformed = BoxSource.transformed(boxes, matrices).boxes()
    check_around(transformed, by_matrix)
    last_row = np.broadcast_to(np.array([0, 0, 0, 1], np.float32), (2000, 1, 4))
    square = np.concatenate([matrices, last_row], axis=1)
    for same in (square, np.asfortranarray(square), square.astype(np.float64)):
        assert np.array_equal(BoxSource.transformed(boxes, same).boxes(), transformed)


@pytest.mark.parametrize("backend", ["in-process", "daemon"])
def test_sources_are_taken_wherever_boxes_are(daemon: Daemon, backend: str) -> None:
    boxes, moved, turned, scaled = some(400, 3)
    source = BoxSource.placed(boxes, moved, turned, scaled)
    world = source.boxes()
    expected = oracle.pairs_of(world)
    assert len(expected) > 50
    with daemon.session(backend) as session:
        oracle.check(session.cull(source), expected)
        frame = session.frame(400)
        frame.write(source)
        assert np.array_equal(frame.boxes, world)
        oracle.check(frame.submit().wait().pairs(), expected)
        narrow = session.narrow_frame(400, pairmask.Precision.q16_around(source))
        narrow.write(source)
        assert expected <= oracle.as_set(narrow.submit().wait().pairs())
        with session.scene() as scene:
            oracle.check(scene.edit().set(range(400), source).submit("all").wait().pairs, expected)
            assert scene.query(source).tolist() == np.argwhere(oracle.overlapping(world, world)).tolist()
        with session.scene(margins="exact") as near:
            oracle.check(near.edit().set(range(400), source, 0.1).commit().begun, expected)
        for wrong in (session.frame(399), session.narrow_frame(399, pairmask.Precision.f16())):
            with pytest.raises(ValueError, match="400 rows for 399 boxes"):
                wrong.write(source)


def test_large_sources_are_the_same() -> None:
    boxes, moved, turned, scaled = some(50_000, 4)
    parts = [
        BoxSource.placed(*(array[at : at + 500] for array in (boxes, moved, turned, scaled))).boxes()
        for at in range(0, 50_000, 500)
    ]
    assert np.array_equal(BoxSource.placed(boxes, moved, turned, scaled).boxes(), np.vstack(parts))


def test_what_overlaps_nothing() -> None:
    boxes = np.array([[0, 0, 0, 1, 1, 1], [1, 0, 0, 0, 1, 1], [np.nan, 0, 0, 1, 1, 1]], np.float32)
    got = BoxSource.placed(boxes, np.array([[np.inf, 0, 0]] * 3)).boxes()
    assert np.isnan(got[0]).all() and (got[1, :3] > got[1, 3:]).any() and np.isnan(got[2]).all()


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda: BoxSource.min_max(np.zeros((2, 3)), np.zeros((3, 3))), ValueError),
        (lambda: BoxSource.center_half(np.zeros((2, 3)), np.zeros(3)), ValueError),
        (lambda: BoxSource.center_half(np.full((2, 3), 0.1), np.zeros((2, 3))), ValueError),
        (lambda: BoxSource.min_max("a", "b"), ValueError),
        (lambda: BoxSource.min_max([["a"] * 3], [["b"] * 3]), TypeError),
        (lambda: BoxSource.transformed(np.zeros((2, 6)), np.zeros((3, 3, 4))), ValueError),
        (lambda: BoxSource.transformed(np.zeros((2, 6)), np.zeros((2, 3, 3))), ValueError),
        (lambda: BoxSource.transformed(np.zeros((2, 6)), np.zeros((2, 12))), ValueError),
        (lambda: BoxSource.transformed(np.zeros((2, 6)), np.zeros((2, 4, 4), complex)), TypeError),
        (lambda: BoxSource.placed(np.zeros((2, 6)), np.zeros((1, 3))), ValueError),
        (lambda: BoxSource.placed(np.zeros((2, 6)), np.zeros((2, 3)), np.zeros((2, 3))), ValueError),
        (lambda: BoxSource.placed(np.zeros((2, 6)), np.zeros((2, 3)), scale=np.zeros((1, 3))), ValueError),
        (lambda: BoxSource(), TypeError),
    ],
)
def test_what_is_wrong_with_sources(make: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        make()
