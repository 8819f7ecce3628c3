"""A batch of reinforcement learning: 4,096 worlds of 32 boxes, one frame a step.

    python -m pairmask.examples worlds_batch
    python -m pairmask.examples worlds_batch --worlds 256 --steps 10

Each world is an episode of its own: 31 balls that bounce in a box, and an agent that has to touch none of them.
All worlds are one frame. Their boxes stand in one array, world after world, and rules keep the worlds apart, so
that a step is one call and its answer one array. The rules stay the same, so that a daemon is sent them once.
"""

import argparse
import time

import numpy as np
import pairmask

BOXES = 32
# Half the edge of a box, and half the edge of a world, units.
HALF, WORLD = 0.5, 8.0
# Seconds of a step.
STEP = 1 / 60


def main() -> None:
    parser = argparse.ArgumentParser(description="A batch of worlds, one frame a step")
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--steps", type=int, default=100)
    given = parser.parse_args()
    worlds, random = given.worlds, np.random.default_rng(1)
    slots = random.uniform(-WORLD, WORLD, (worlds, BOXES, 3)).astype(np.float32)
    speeds = random.normal(0, 4, (worlds, BOXES, 3)).astype(np.float32)
    touches = np.zeros(worlds, np.int64)
    session = pairmask.Session()
    rules = pairmask.Rules(worlds=np.repeat(np.arange(worlds), BOXES))
    began = time.perf_counter()
    for _ in range(given.steps):
        # Box 0 of each world is its agent, which acts at random.
        speeds[:, 0] = random.normal(0, 2, (worlds, 3))
        slots += STEP * speeds
        speeds[np.abs(slots) > WORLD] *= -1
        np.clip(slots, -WORLD, WORLD, out=slots)
        frame = session.frame(worlds * BOXES)
        # Written where it lies: in memory that is shared with the daemon, if one serves.
        boxes = frame.boxes.reshape(worlds, BOXES, 6)
        np.subtract(slots, HALF, out=boxes[..., :3])
        np.add(slots, HALF, out=boxes[..., 3:])
        # An array over the frame's memory has to be dropped before the frame is submitted.
        del boxes
        with frame.submit(filters=rules).wait() as mask:
            pairs = mask.pairs()
        # a < b, so that an agent, which is the first box of its world, is always a.
        agents = pairs[pairs[:, 0] % BOXES == 0, 0] // BOXES
        touches += np.bincount(agents, minlength=worlds)
    took = (time.perf_counter() - began) / given.steps
    worst = int(touches.argmax())
    print(f"{worlds} worlds of {BOXES} boxes, {session.served_by()}: {took * 1e3:.2f} ms a step")
    print(f"{touches.sum()} touches in {given.steps} steps; world {worst} has most: {touches[worst]}")


if __name__ == "__main__":
    main()
