"""The comparator can fail, and the oracle agrees with the wire contract."""

import numpy as np
import oracle
import pytest
from conftest import UNIT


def test_the_rules_of_boxes_hold() -> None:
    nan, inf = float("nan"), float("inf")
    boxes = np.array(
        [UNIT, [1, -0.0, 0, 2, 1, 1], [1, 0, 0, 0.5, 1, 1], [nan, 0, 0, 1, 1, 1], [-inf, 0, 0, inf, 1, 1]],
        np.float32,
    )
    assert oracle.pairs_of(boxes) == {(0, 1), (0, 4), (1, 4)}


def test_a_pair_that_is_missed_or_extra_is_noticed() -> None:
    expected = {(0, 1), (1, 2)}
    pairs = np.array([[0, 1], [1, 2]], np.uint32)
    oracle.check(pairs, expected)
    for wrong in (pairs[:1], np.vstack([pairs, [[0, 2]]]).astype(np.uint32), pairs[[0, 0, 1]], pairs[:, ::-1]):
        with pytest.raises(AssertionError):
            oracle.check(wrong, expected)
    for bit in range(64):
        flipped = pairs.copy()
        flipped.reshape(-1)[bit // 32] ^= np.uint32(1 << bit % 32)
        with pytest.raises(AssertionError):
            oracle.check(flipped, expected)
