"""What is taken as an array, and what is refused.

The extension reads float32 arrays (n, columns) and arrays of the right integers where they lie. All other
objects come here first. No number is rounded here but outward or not at all.
"""

from typing import Any

import numpy as np

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


def _numbers(given: Any, columns: int, may_be_one: bool) -> Any:
    array = _array(given)
    # Corners may have a dimension of their own.
    if columns == 6 and array.shape[-2:] == (2, 3) and array.ndim in ((2, 3) if may_be_one else (3,)):
        array = array.reshape(-1, 6)
    if array.ndim == 1 and (array.size == 0 or (may_be_one and array.size == columns)):
        array = array.reshape(-1, columns)
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"an array of shape {array.shape}: give (n, {columns})")
    if array.dtype.kind not in "fiu" or array.dtype.itemsize > 8:
        raise TypeError(f"numbers of type {array.dtype}: give float32 or float64")
    return array


def floats(given: Any, columns: int, may_be_one: bool) -> Any:
    """float32 as it is, all else as float64, which the extension rounds outward."""
    array = _numbers(given, columns, may_be_one)
    if array.dtype.kind == "f" and array.dtype.itemsize <= 4:
        return _in_rows(array, np.float32)
    return _doubles(array)


def doubles(given: Any, columns: int) -> Any:
    """All as float64."""
    return _doubles(_numbers(given, columns, False))


def _doubles(array: Any) -> Any:
    if array.dtype.kind in "iu" and array.dtype.itemsize == 8 and array.size:
        if int(array.max()) > EXACT_INTEGERS or int(array.min()) < -EXACT_INTEGERS:
            raise ValueError("an integer beyond 2**53 is no number of float64: round it yourself")
    return _in_rows(array, np.float64)


def integers(given: Any, numpy_type: str) -> Any:
    """Integers in one row, each of them within a type. Truth values are 0 and 1."""
    array = _array(given)
    if array.ndim == 0:
        array = array.reshape(1)
    if array.ndim != 1:
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
        return _in_range(int(given), 1)
    if isinstance(given, range) and given.step == 1:
        return _in_range(given.start, len(given)) if len(given) else (0, 0)
    array = _array(given)
    if array.dtype.kind == "b" and array.ndim == 1:
        array = np.flatnonzero(array)
    return integers(array, "uint32")


def _in_range(first: int, count: int) -> tuple[int, int]:
    if first < 0 or first + count > INDEX_END:
        wrong = first if first < 0 else first + count - 1
        raise ValueError(f"{wrong} is no index: give 0 to {INDEX_END - 1}")
    # A count of 2**32 has no place in 32 bits, and no scene holds as many boxes.
    return first, min(count, INDEX_END - 1)


def pairs(given: Any) -> Any:
    """Pairs of indices as uint32 (n, 2); a single pair may come without the brackets around it."""
    array = _array(given)
    if array.ndim == 1 and array.size in (0, 2):
        array = array.reshape(-1, 2)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"pairs of shape {array.shape}: give (n, 2)")
    return integers(array.reshape(-1), "uint32")


def matrices(given: Any) -> Any:
    """Matrices (n, 3, 4) or (n, 4, 4), of which the last row is left out, as rows of twelve numbers."""
    array = _array(given)
    if array.ndim != 3 or array.shape[1] not in (3, 4) or array.shape[2] != 4:
        raise ValueError(f"matrices of shape {array.shape}: give (n, 3, 4) or (n, 4, 4)")
    return array[:, :3].reshape(-1, 12)
