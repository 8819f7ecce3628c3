"""Pairmask: which of many boxes overlap. Broad-phase collision culling with numpy arrays.

    import numpy as np
    import pairmask

    with pairmask.Session() as session:
        pairs = session.cull(np.array([[0, 0, 0, 1, 1, 1], [1, 0, 0, 2, 1, 1]], np.float32))
"""

from . import filters as filters
from ._answers import EndReason as EndReason, FrameInfo as FrameInfo
from ._answers import Hits as Hits, MarginStats as MarginStats, SceneAnswer as SceneAnswer
from ._errors import ConnectError as ConnectError, PairmaskError as PairmaskError, WaitTimeout as WaitTimeout
from ._pairmask import Filter as Filter, FilterTable as FilterTable, Rules as Rules
from ._pairmask import Frame as Frame, PairMask as PairMask, PendingFrame as PendingFrame, Precision as Precision
from ._pairmask import PendingAnswer as PendingAnswer, Scene as Scene, SceneEdit as SceneEdit
from ._pairmask import Session as Session, __version__ as __version__
from ._pairmask import outward_from_f64 as outward_from_f64, placed as placed, points as points
from ._pairmask import swept as swept, swept_by as swept_by, transformed as transformed

# The world of boxes that are in all worlds.
ALL_WORLDS = -1
