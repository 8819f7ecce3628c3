"""What answers hold. The extension makes them."""

from enum import IntEnum
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Pairs: TypeAlias = NDArray[np.uint32]


class EndReason(IntEnum):
    """Why a pair ended: the numbers of `SceneAnswer.ended_reasons`."""

    REMOVED = 0
    FILTERED = 1
    SEPARATED = 2


class FrameInfo(NamedTuple):
    """Facts about an answered frame beside its pairs."""

    served_by: Literal["daemon", "in-process"]
    engine: str
    threads: int  # that the engine could use
    form: str  # of the boxes, or spheres
    invalid: int  # boxes with a NaN
    empty: int  # boxes with `min > max` on some axis
    first_invalid: list[int]  # the lowest indices, eight at most
    is_repeat: bool  # equal to the last frame, so that no engine looked at it
    skipped_pairs: int  # that were never compared
    mask_bytes: int
    box_bytes: int  # of the boxes or spheres
    total_ns: int  # from the request in hand to the response ready to be sent


class SceneAnswer(NamedTuple):
    """What an edit reports. All lists are sorted, and arrays can only be read."""

    begun: Pairs  # (n, 2) that began, for "changes"
    ended: Pairs  # (m, 2) that ended, for "changes"
    ended_reasons: NDArray[np.uint8]  # (m), values of `EndReason`
    pairs: Pairs  # (count, 2) of now, for "all", "moved" and a resync
    is_resync: bool  # changes were asked for, and `pairs` holds all pairs instead
    pair_count: int | None  # of the whole scene, if the answer knows
    served_by: Literal["daemon", "in-process"]
    engine: str
    skipped_pairs: int  # that were not tested
    tick: int | None  # of a shared scene
    late: list[range]  # leases of writers of a shared scene that were late


class Hits(NamedTuple):
    """What rays have hit, or is near points: by query, by distance, and then by index."""

    pairs: Pairs  # (n, 2) rows (query, index)
    distances: NDArray[np.float32]  # (n)


class MarginStats(NamedTuple):
    """Boxes that were set, and how few of them were sent."""

    edits: int  # that were applied
    requests: int  # edits for which a request was made
    set: int  # boxes that edits set
    sent: int  # boxes that were sent
