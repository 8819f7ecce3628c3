"""The filters of other engines, as `pairmask.Filter`s: their fields in, what they decide out."""

from ._pairmask import from_avian as from_avian, from_box2d as from_box2d, from_bullet as from_bullet
from ._pairmask import from_jolt_mask as from_jolt_mask, from_mujoco as from_mujoco, from_newton as from_newton
from ._pairmask import from_physx_words as from_physx_words, from_rapier as from_rapier, owner_of as owner_of
