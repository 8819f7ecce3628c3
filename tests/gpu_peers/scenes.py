"""Boxes of a `pairmaskd scene` file and how they move: the motion of `pairmaskd bench latency`.

Each box moves 2 % of its mean edge a frame, in a direction of its own, and turns round at the
bounds of the scene. The directions are drawn from the same stream (SplitMix64, seed 1) as in
daemon/src/scene; sines and cosines are rounded from f64, so a coordinate may differ from the
daemon's in its last bit.
"""

import numpy as np

STEP_SHARE = np.float32(0.02)
SEED = 1


def read(path):
    """Lower and upper corners of a file of boxes, f32, shape (n, 3) each."""
    boxes = np.fromfile(path, dtype="<f4").reshape(-1, 6)
    return np.ascontiguousarray(boxes[:, :3]), np.ascontiguousarray(boxes[:, 3:])


def write(path, lower, upper):
    """The same, back into a file of boxes."""
    np.hstack([lower, upper]).astype("<f4").tofile(path)


def bits(seed, count):
    """The first `count` numbers of the stream of `seed` (Steele, Lea, Flood 2014)."""
    with np.errstate(over="ignore"):
        z = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(seed)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))


def directions(seed, n):
    """`n` directions, uniform on the sphere, f32."""
    unit = (bits(seed, 2 * n) >> np.uint64(40)).astype(np.float32) / np.float32(2**24)
    z = np.float32(-1) + np.float32(2) * unit[0::2]
    angle = (np.float32(2 * np.pi) * unit[1::2]).astype(np.float64)
    radius = np.sqrt(np.maximum(np.float32(1) - z * z, np.float32(0)))
    sin, cos = np.sin(angle).astype(np.float32), np.cos(angle).astype(np.float32)
    return np.stack([radius * cos, radius * sin, z], axis=1)


class Scene:
    """Boxes in motion. All coordinates must be finite."""

    def __init__(self, lower, upper):
        self.lower, self.upper = lower.copy(), upper.copy()
        edges = upper - lower
        size = (edges[:, 0] + edges[:, 1] + edges[:, 2]) / np.float32(3)
        self.velocity = directions(SEED, len(lower)) * (STEP_SHARE * size)[:, None]
        self.low, self.high = lower.min(axis=0), upper.max(axis=0)

    def step(self):
        """Goes on to the next frame."""
        half = np.float32(0.5)
        centre = half * self.lower + half * self.upper + self.velocity
        speed = np.abs(self.velocity)
        turned = np.where(centre > self.high, -speed, self.velocity)
        self.velocity = np.where(centre < self.low, speed, turned)
        self.lower += self.velocity
        self.upper += self.velocity
