"""Sets of pairs as sorted arrays of 64-bit numbers: a in the high half, b in the low one, a < b."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Difference:
    """How a list of pairs differs from the exact set."""

    expected: int
    missed: int
    extra: int
    repeated: int

    @property
    def is_exact(self):
        return self.missed == self.extra == self.repeated == 0


def keys(pairs):
    """The sorted numbers of pairs, shape (count, 2), in any order each pair stands."""
    pairs = np.asarray(pairs).reshape(-1, 2).astype(np.uint64)
    low, high = pairs.min(axis=1), pairs.max(axis=1)
    return np.sort((low << np.uint64(32)) | high)


def read(path):
    """The numbers of a file of `pairmaskd cull --pairs`."""
    return keys(np.fromfile(path, dtype="<u4"))


def compare(found, expected):
    """The difference of two results of `keys`; `expected` has no repetitions."""
    if np.array_equal(found, expected):
        return Difference(expected=len(expected), missed=0, extra=0, repeated=0)
    unique = np.unique(found)
    common = len(np.intersect1d(unique, expected, assume_unique=True))
    return Difference(
        expected=len(expected),
        missed=len(expected) - common,
        extra=len(unique) - common,
        repeated=len(found) - len(unique),
    )
