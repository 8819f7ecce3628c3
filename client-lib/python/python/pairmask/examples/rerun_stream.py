"""Streams a scene and its pairs into the Rerun viewer, or into an .rrd file.

    pip install 'pairmask[rerun]'
    python -m pairmask.examples rerun_stream                    opens the viewer
    python -m pairmask.examples rerun_stream --save scene.rrd   writes a file, which `rerun scene.rrd` shows

Boxes drift in a persistent scene. Each step sends the boxes that moved, and gets the pairs that began and ended.
Boxes in touch are shown in another colour, with a line from centre to centre.
"""

import argparse
from typing import Any

import numpy as np
import pairmask
import rerun as rr

# Half the edge of the world, units.
WORLD = 10.0
FREE, TOUCHING, LINE = (120, 130, 150), (240, 120, 60), (250, 220, 80)


def main() -> None:
    parser = argparse.ArgumentParser(description="A scene and its pairs in the Rerun viewer")
    parser.add_argument("--save", help="write this .rrd file in place of opening the viewer")
    parser.add_argument("--boxes", type=int, default=300)
    parser.add_argument("--steps", type=int, default=200)
    given = parser.parse_args()
    rr.init("pairmask", spawn=given.save is None)
    if given.save is not None:
        rr.save(given.save)

    random = np.random.default_rng(1)
    slots = random.uniform(-WORLD, WORLD, (given.boxes, 3)).astype(np.float32)
    halves = random.uniform(0.2, 0.9, (given.boxes, 3)).astype(np.float32)
    speeds = random.normal(0, 1.5, (given.boxes, 3)).astype(np.float32)
    pairs: set[tuple[int, int]] = set()

    with pairmask.Session() as session, session.scene() as scene:
        for step in range(given.steps):
            # A third of the boxes rests in each step: only what moved is sent.
            moved = np.flatnonzero((np.arange(given.boxes) + step // 20) % 3 != 0)
            slots[moved] += speeds[moved] / 60
            speeds[np.abs(slots) > WORLD] *= -1
            moved = moved if step else np.arange(given.boxes)
            boxes = np.hstack([slots - halves, slots + halves])[moved]
            answer = scene.edit().set(moved, boxes).commit()
            if answer.is_resync:
                pairs = rows(answer.pairs)
            pairs = (pairs - rows(answer.ended)) | rows(answer.begun)
            ends = np.array(sorted(pairs), np.int64).reshape(-1, 2)
            colors = np.tile(np.array(FREE, np.uint8), (given.boxes, 1))
            colors[ends.reshape(-1)] = TOUCHING
            rr.set_time("step", sequence=step)
            rr.log("scene/boxes", rr.Boxes3D(centers=slots, half_sizes=halves, colors=colors))
            rr.log("scene/pairs", rr.LineStrips3D(slots[ends], colors=[LINE]))
            rr.log("changes/begun", rr.Scalars(len(answer.begun)))
            rr.log("changes/ended", rr.Scalars(len(answer.ended)))
            rr.log("pairs", rr.Scalars(len(pairs)))
        print(f"{given.steps} steps, {len(pairs)} pairs at the end, {session.served_by()}")


def rows(pairs: Any) -> set[tuple[int, int]]:
    return {(a, b) for a, b in pairs.tolist()}


if __name__ == "__main__":
    main()
