"""What is accepted as an array, and what is refused.

The extension reads float32 arrays (n, columns) where they lie. All other objects come here first. No number is
rounded here but outward or not at all, except for those of rays and points, which are rounded to the nearest.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ._pairmask import outward_from_f64, spheres_from_f64

# Integers up to this are numbers of float64.
EXACT_INTEGERS = 2**53
# Indices are below this.
INDEX_END = 2**32


def _in_rows(array: Any, dtype: Any) -> Any:
    """The array as the extension reads it: of this machine's byte order, row by row, aligned."""
    return np.require(array, dtype=dtype, requirements=["C", "A"])


def _array(given: Any) -> Any:
    if isinstance(given, np.ma.MaskedArray):
        raise TypeError("a masked array: give its filled() or compressed() values")
    return np.asarray(given)


def rows(given: Any, columns: int) -> Any:
    """Boxes or spheres of float32: all else is rounded outward."""
    array = _floats(given, columns)
    if array.dtype == np.float64:
        array = outward_from_f64(array) if columns == 6 else spheres_from_f64(array)
    return array


def doubles(given: Any, columns: int) -> Any:
    """Rows of float64."""
    return _in_rows(_floats(given, columns), np.float64)


def _floats(given: Any, columns: int) -> Any:
    """Rows of float32 as they are, and of all else as float64. A single row may come without the brackets around it."""
    array = _array(given)
    # Corners may have a dimension of their own.
    if columns == 6 and array.ndim in (2, 3) and array.shape[-2:] == (2, 3):
        array = array.reshape(-1, 6)
    if array.ndim == 1 and array.size in (0, columns):
        array = array.reshape(-1, columns)
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"an array of shape {array.shape}: give (n, {columns})")
    if array.dtype.kind not in "fiu" or array.dtype.itemsize > 8:
        raise TypeError(f"numbers of type {array.dtype}: give float32 or float64")
    if array.dtype.kind == "f":
        return _in_rows(array, np.float32 if array.dtype.itemsize <= 4 else np.float64)
    if array.size and max(int(array.max()), -int(array.min())) > EXACT_INTEGERS:
        raise ValueError("an integer beyond 2**53 is no number of float64: round it yourself")
    return _in_rows(array, np.float64)


def exact(given: Any, columns: int) -> Any:
    """Rows of float32. Numbers that it does not hold are refused."""
    array = _floats(given, columns)
    with np.errstate(over="ignore"):
        narrow = array.astype(np.float32, copy=False)
    wrong = array[(narrow != array) & ~np.isnan(array)]
    if wrong.size:
        raise ValueError(f"{wrong[0]} is no number of float32: round it yourself")
    return narrow


def _near(given: Any, columns: int) -> Any:
    """Rows of float32; numbers that it does not hold are rounded to the nearest."""
    with np.errstate(over="ignore"):
        return _floats(given, columns).astype(np.float32, copy=False)


def _in_columns(columns: Sequence[tuple[Any, int]], what: str) -> Any:
    """Columns side by side, each of one row for all or of as many rows as the longest has."""
    n = max((len(part) for part, _ in columns if len(part) != 1), default=1)
    array = np.empty((n, sum(width for _, width in columns)), np.float32)
    at = 0
    for part, width in columns:
        if len(part) not in (1, n):
            raise ValueError(f"{len(part)} rows for {n} {what}: give one for each, or one for all")
        array[:, at : at + width] = part
        at += width
    return array


def _numbers(given: Any) -> Any:
    """A number for all, or one for each, as a column."""
    return _near(_array(given).reshape(-1, 1), 1)


def rays(origins: Any, directions: Any, most: Any, half_extents: Any) -> Any:
    """Rays as rows of ten float32."""
    most = _numbers(np.inf if most is None else most)
    half_extents = _near(np.zeros(3) if half_extents is None else half_extents, 3)
    columns = [(_near(origins, 3), 3), (_near(directions, 3), 3), (most, 1), (half_extents, 3)]
    return _in_columns(columns, "rays")


def balls(points: Any, radius: Any) -> Any:
    """Points and how far boxes may be from them, as rows of four float32."""
    radius = _numbers(np.inf if radius is None else radius)
    return _in_columns([(_near(points, 3), 3), (radius, 1)], "points")


def matrices(given: Any) -> Any:
    """Matrices (n, 3, 4) or (n, 4, 4), of which the last row is left out, as rows of their four columns."""
    array = _array(given)
    if array.ndim != 3 or array.shape[1] not in (3, 4) or array.shape[2] != 4:
        raise ValueError(f"matrices of shape {array.shape}: give (n, 3, 4) or (n, 4, 4)")
    return exact(array[:, :3].transpose(0, 2, 1).reshape(-1, 12), 12)


def integers(given: Any, numpy_type: str) -> Any:
    """Integers in one row, or a single one, each within a type. Truth values are 0 and 1."""
    array = _array(given)
    if array.ndim > 1:
        raise ValueError(f"an array of shape {array.shape}: give (n,)")
    if array.dtype.kind == "O" or (array.size and array.dtype.kind not in "iub"):
        raise TypeError(f"numbers of type {array.dtype}: give integers")
    if array.size and array.dtype != np.dtype(numpy_type):
        limits = np.iinfo(numpy_type)
        low, high = int(array.min()), int(array.max())
        if low < limits.min or high > limits.max:
            wrong = low if low < limits.min else high
            raise ValueError(f"{wrong} is none of {limits.min} to {limits.max}")
    return _in_rows(array, numpy_type)


def indices(given: Any) -> Any:
    """(first, count) of an index or a range without gaps, else an array of indices."""
    if isinstance(given, (bool, np.bool_)):
        raise TypeError("a truth value is no index")
    if isinstance(given, (int, np.integer)):
        given = range(int(given), int(given) + 1)
    if isinstance(given, range) and given.step == 1:
        first, end = (given.start, given.stop) if given else (0, 0)
        if first < 0 or end > INDEX_END:
            wrong = first if first < 0 else end - 1
            raise ValueError(f"{wrong} is no index: give 0 to {INDEX_END - 1}")
        # A count of 2**32 does not fit into 32 bits, and no scene holds as many boxes.
        return first, min(end - first, INDEX_END - 1)
    array = _array(given)
    if array.dtype.kind == "b" and array.ndim == 1:
        array = np.flatnonzero(array)
    return integers(np.atleast_1d(array), "uint32")


def flat_indices(given: Any) -> Any:
    """Indices of any shape in one row, and their shape."""
    array = _array(given)
    if array.dtype.kind == "b" and array.ndim == 1:
        array = np.flatnonzero(array)
    return integers(array.reshape(-1), "uint32"), array.shape


def user_data(given: Any, n: int) -> Any:
    """User data of `n` boxes: an integer for all, or one for each."""
    array = integers(given, "uint64")
    return _in_rows(np.broadcast_to(array, n) if array.ndim == 0 else array, np.uint64)


def pairs(given: Any) -> Any:
    """Pairs of indices as uint32 in one row; a single pair may come without the brackets around it."""
    array = _array(given)
    if array.ndim == 1 and array.size in (0, 2):
        array = array.reshape(-1, 2)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"pairs of shape {array.shape}: give (n, 2)")
    return integers(array.reshape(-1), "uint32")


FILTER_DATA = [("worlds", "int32"), ("owners", "uint32"), ("filters", "uint16"), ("static flags", "uint8")]


def filter_data(n: int | None, parts: Sequence[Any]) -> Any:
    """Worlds, owners, filters and static flags of `n` boxes: a number for all, or one for each. Without `n`, of as many
    as there are in the first array, or of one."""
    arrays = [integers(0 if part is None else part, numpy_type) for part, (_, numpy_type) in zip(parts, FILTER_DATA)]
    if n is None:
        n = next((array.size for array in arrays if array.ndim), 1)
    for array, (name, _) in zip(arrays, FILTER_DATA):
        if array.ndim and array.size != n:
            raise ValueError(f"{array.size} {name} for {n} boxes: give one for each")
    return tuple(np.broadcast_to(array, n) for array in arrays)
