"""The filters of other engines, as `pairmask.Filter`s: their fields in, what they decide out."""

from ._pairmask import (
    from_avian,
    from_box2d,
    from_bullet,
    from_jolt_mask,
    from_mujoco,
    from_newton,
    from_physx_words,
    from_rapier,
    owner_of,
)

__all__ = [
    "from_avian",
    "from_box2d",
    "from_bullet",
    "from_jolt_mask",
    "from_mujoco",
    "from_newton",
    "from_physx_words",
    "from_rapier",
    "owner_of",
]
