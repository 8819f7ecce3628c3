"""The naive answer: every pair is tested, by the words of the Rust library's `aabb` module."""

from typing import Any

import numpy as np

Pairs = set[tuple[int, int]]


def overlapping(a: Any, b: Any) -> Any:
    """Which boxes of `a` (rows) overlap which of `b` (columns): closed boxes, none of them empty or with a NaN."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)

    def valid(boxes: Any) -> Any:
        # A comparison with a NaN is false.
        return (boxes[:, :3] <= boxes[:, 3:]).all(axis=1)

    found = valid(a)[:, None] & valid(b)[None, :]
    for axis in range(3):
        found &= a[:, None, axis] <= b[None, :, axis + 3]
        found &= b[None, :, axis] <= a[:, None, axis + 3]
    return found


def distances(points: Any, boxes: Any) -> Any:
    """How far boxes (columns) are from points (rows)."""
    points, boxes = np.asarray(points, np.float64)[:, None], np.asarray(boxes, np.float64)
    gaps = np.maximum(np.maximum(boxes[:, :3] - points, points - boxes[:, 3:]), 0)
    return np.sqrt((gaps**2).sum(axis=2))


def entries(origins: Any, directions: Any, boxes: Any) -> Any:
    """Where rays along one axis each (rows) enter boxes (columns); infinite where they do not."""
    found = np.full((len(origins), len(boxes)), np.inf)
    for ray, (origin, direction) in enumerate(zip(origins, directions)):
        axis = int(np.argmax(direction))
        others = [other for other in range(3) if other != axis]
        within = (boxes[:, others] <= origin[others]) & (origin[others] <= boxes[:, [3 + other for other in others]])
        is_hit = within.all(axis=1) & (boxes[:, 3 + axis] >= origin[axis])
        found[ray, is_hit] = np.maximum(boxes[is_hit, axis] - origin[axis], 0)
    return found


def pairs_of(boxes: Any, meet: Any = None) -> Pairs:
    """The pairs (a, b), a < b. `meet` is a matrix of which boxes may meet."""
    found = np.triu(overlapping(boxes, boxes), 1)
    if meet is not None:
        found &= meet
    return {(int(a), int(b)) for a, b in np.argwhere(found)}


def sphere_pairs_of(spheres: Any) -> Pairs:
    """Pairs of spheres whose numbers are small integers, so that float64 is exact."""
    spheres = np.asarray(spheres, np.float64)
    between = spheres[:, None, :3] - spheres[None, :, :3]
    reach = spheres[:, None, 3] + spheres[None, :, 3]
    found = np.triu((between**2).sum(axis=2) <= reach**2, 1)
    return {(int(a), int(b)) for a, b in np.argwhere(found)}


def as_set(pairs: Any) -> Pairs:
    """An array of pairs as a set. Fails where one is reported twice or is no pair."""
    assert pairs.dtype == np.uint32 and pairs.ndim == 2 and pairs.shape[1] == 2
    found = {(a, b) for a, b in pairs.tolist()}
    assert len(found) == len(pairs), "a pair is reported twice"
    assert all(a < b for a, b in found), "a pair is the wrong way round"
    return found


def check(got: Any, expected: Pairs, what: object = "") -> None:
    """Compares sets, and names the first pair that is missed or extra."""
    found = as_set(got)
    missed, extra = expected - found, found - expected
    assert not missed and not extra, (
        f"{what}: {len(missed)} missed, {len(extra)} extra, first {min(missed | extra)}"
    )


def boxes_of(n: int, seed: int, *, spread: float = 1.0) -> Any:
    """Random boxes, about two pairs a box where `spread` is 1."""
    random = np.random.default_rng(seed)
    side = spread * max(n, 1) ** (1 / 3)
    low = random.random((n, 3)) * side
    size = random.random((n, 3)) * 1.2
    return np.hstack([low, low + size]).astype(np.float32)
