"""Pairmask: which of many boxes overlap. Broad-phase collision culling with numpy arrays.

    import numpy as np
    import pairmask

    with pairmask.Session() as session:
        pairs = session.cull(np.array([[0, 0, 0, 1, 1, 1], [1, 0, 0, 2, 1, 1]], np.float32))
"""

from enum import IntEnum as _IntEnum

from . import filters
from ._errors import ConnectError, PairmaskError, WaitTimeout
from ._pairmask import (
    BoxSource,
    Filter,
    FilterTable,
    Frame,
    FrameInfo,
    MarginStats,
    PairMask,
    PendingAnswer,
    PendingFrame,
    Precision,
    Rules,
    Scene,
    SceneAnswer,
    SceneEdit,
    Session,
    __version__,
    outward_from_f64,
    points,
    swept,
    swept_by,
)

# The world of boxes that are in all worlds.
ALL_WORLDS = -1


class EndReason(_IntEnum):
    """Why a pair ended: the numbers of `SceneAnswer.ended_reasons`."""

    REMOVED = 0
    FILTERED = 1
    SEPARATED = 2


__all__ = [
    "ALL_WORLDS",
    "BoxSource",
    "ConnectError",
    "EndReason",
    "Filter",
    "FilterTable",
    "Frame",
    "FrameInfo",
    "MarginStats",
    "PairMask",
    "PairmaskError",
    "PendingAnswer",
    "PendingFrame",
    "Precision",
    "Rules",
    "Scene",
    "SceneAnswer",
    "SceneEdit",
    "Session",
    "WaitTimeout",
    "__version__",
    "filters",
    "outward_from_f64",
    "points",
    "swept",
    "swept_by",
]
