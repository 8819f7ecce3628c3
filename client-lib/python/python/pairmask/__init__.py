"""Pairmask: which of many boxes overlap. Broad-phase collision culling with numpy arrays.

    import numpy as np
    import pairmask

    with pairmask.Session() as session:
        pairs = session.cull(np.array([[0, 0, 0, 1, 1, 1], [1, 0, 0, 2, 1, 1]], np.float32))
"""

from . import filters as filters
from ._answers import EndReason as EndReason
from ._answers import FrameInfo as FrameInfo
from ._answers import MarginStats as MarginStats
from ._answers import SceneAnswer as SceneAnswer
from ._errors import ConnectError as ConnectError
from ._errors import PairmaskError as PairmaskError
from ._errors import WaitTimeout as WaitTimeout
from ._pairmask import Filter as Filter
from ._pairmask import FilterTable as FilterTable
from ._pairmask import Frame as Frame
from ._pairmask import PairMask as PairMask
from ._pairmask import PendingAnswer as PendingAnswer
from ._pairmask import PendingFrame as PendingFrame
from ._pairmask import Precision as Precision
from ._pairmask import Rules as Rules
from ._pairmask import Scene as Scene
from ._pairmask import SceneEdit as SceneEdit
from ._pairmask import Session as Session
from ._pairmask import __version__ as __version__
from ._pairmask import outward_from_f64 as outward_from_f64
from ._pairmask import placed as placed
from ._pairmask import points as points
from ._pairmask import swept as swept
from ._pairmask import swept_by as swept_by
from ._pairmask import transformed as transformed

# The world of boxes that are in all worlds.
ALL_WORLDS = -1
