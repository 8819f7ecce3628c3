"""Functions that make boxes, against the same in float64."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from pairmask import placed, transformed


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
    assert got.dtype == np.float32 and got.shape == (len(points), 6) and got.flags.writeable
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


def test_transforms_hold_all_corners() -> None:
    boxes, moved, turned, scaled = some(2000, 2)
    points, offset = corners(boxes), moved[:, None].astype(np.float64)
    linear = rotations(turned.astype(np.float64))
    check_around(placed(boxes, moved), points + offset)
    check_around(placed(boxes, moved, rotation=turned), np.einsum("nij,nkj->nki", linear, points) + offset)
    world = np.einsum("nij,nkj->nki", linear, points * scaled[:, None].astype(np.float64)) + offset
    check_around(placed(boxes.reshape(-1, 2, 3), moved, turned, scaled), world)
    matrices = np.concatenate([linear, moved[:, :, None]], axis=2).astype(np.float32)
    exact = matrices.astype(np.float64)
    by_matrix = np.einsum("nij,nkj->nki", exact[:, :, :3], points) + exact[:, None, :, 3]
    around = transformed(boxes, matrices)
    check_around(around, by_matrix)
    last_row = np.broadcast_to(np.array([0, 0, 0, 1], np.float32), (2000, 1, 4))
    square = np.concatenate([matrices, last_row], axis=1)
    for same in (square, np.asfortranarray(square), square.astype(np.float64)):
        assert np.array_equal(transformed(boxes, same), around)


def test_many_transforms_are_the_same() -> None:
    arrays = some(50_000, 4)
    parts = [placed(*(array[at : at + 500] for array in arrays)) for at in range(0, 50_000, 500)]
    assert np.array_equal(placed(*arrays), np.vstack(parts))


def test_what_overlaps_nothing() -> None:
    boxes = np.array([[0, 0, 0, 1, 1, 1], [1, 0, 0, 0, 1, 1], [np.nan, 0, 0, 1, 1, 1]], np.float32)
    got = placed(boxes, np.array([[np.inf, 0, 0]] * 3))
    assert np.isnan(got[0]).all() and (got[1, :3] > got[1, 3:]).any() and np.isnan(got[2]).all()


def test_points_and_sweeps() -> None:
    asked = oracle.boxes_of(40, 6, spread=2)
    assert np.array_equal(pairmask.points(asked[:, :3]), np.hstack([asked[:, :3]] * 2))
    moved = asked + np.float32(2)
    swept = np.hstack([np.minimum(asked, moved)[:, :3], np.maximum(asked, moved)[:, 3:]])
    assert np.array_equal(pairmask.swept(asked, moved), swept)
    by = pairmask.swept_by(asked, np.full((40, 3), 2, np.float32))
    assert (by[:, 3:] >= asked[:, 3:] + 2).all() and (by[:, :3] == asked[:, :3]).all()


@pytest.mark.parametrize(
    ("make", "given", "error"),
    [
        (transformed, [np.zeros((2, 6)), np.zeros((3, 3, 4))], ValueError),
        (transformed, [np.zeros((2, 6)), np.zeros((2, 3, 3))], ValueError),
        (transformed, [np.zeros((2, 6)), np.zeros((2, 12))], ValueError),
        (transformed, [np.zeros((2, 6)), np.full((2, 3, 4), 0.1)], ValueError),
        (transformed, [np.zeros((2, 6)), np.zeros((2, 4, 4), complex)], TypeError),
        (placed, [np.zeros((2, 6)), np.zeros((1, 3))], ValueError),
        (placed, [np.zeros((2, 6)), np.zeros((2, 3)), np.zeros((2, 3))], ValueError),
        (placed, [np.zeros((2, 6)), np.zeros((2, 3)), None, np.zeros((1, 3))], ValueError),
        (placed, [np.zeros((2, 6)), [["a"] * 3] * 2], TypeError),
        (pairmask.swept, [np.zeros((2, 6)), np.zeros((3, 6))], ValueError),
        (pairmask.swept_by, [np.zeros((2, 6)), np.zeros((3, 3))], ValueError),
        (pairmask.points, [[[0.1, 0, 0]]], ValueError),
        (pairmask.points, [[[1e60, 0, 0]]], ValueError),
    ],
)
def test_what_is_refused(make: Any, given: list[Any], error: type[Exception]) -> None:
    with pytest.raises(error):
        make(*given)
