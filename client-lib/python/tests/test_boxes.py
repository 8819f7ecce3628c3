"""Functions that make boxes, against the same in float64."""

from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from pairmask import placed, transformed


def test_transforms_hold_all_corners() -> None:
    n = 200
    boxes, random = oracle.boxes_of(n, 2), np.random.default_rng(2)
    moved, scaled = random.integers(-9, 9, (n, 3)), random.integers(1, 4, (n, 3))
    half_turn = np.tile([0, 0, 1, 0], (n, 1))
    matrices = np.tile(np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 2, 0]], np.float32), (n, 1, 1))
    matrices[:, :, 3] = moved
    last_row = np.broadcast_to(np.array([0, 0, 0, 1], np.float32), (n, 1, 4))
    square = np.concatenate([matrices, last_row], axis=1)
    ends = boxes.astype(np.float64).reshape(-1, 2, 3)
    offset, scale = moved[:, None], scaled[:, None]
    quarter_turn = ends[:, :, [1, 0, 2]] * [-1, 1, 2] + offset
    cases: list[tuple[Any, Any]] = [
        (placed(boxes, moved), ends + offset),
        (placed(boxes, moved, half_turn), ends * [-1, -1, 1] + offset),
        (placed(boxes, moved, scale=scaled), ends * scale + offset),
        (placed(boxes.reshape(-1, 2, 3).tolist(), moved, half_turn, scaled), ends * scale * [-1, -1, 1] + offset),
        *((transformed(boxes, same), quarter_turn) for same in (matrices, square, np.asfortranarray(square))),
        (transformed(boxes, square.astype(np.float64)), quarter_turn),
    ]
    for got, points in cases:
        low, high = points.min(axis=1), points.max(axis=1)
        assert got.dtype == np.float32 and got.shape == (n, 6) and got.flags.writeable
        assert (got[:, :3] <= low).all() and (got[:, 3:] >= high).all()
        assert np.allclose(got, np.hstack([low, high]), rtol=1e-5, atol=1e-5)


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
