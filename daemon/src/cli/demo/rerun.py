"""Writes what it reads on stdin to a recording for the viewer Rerun: `python3 rerun.py FILE`.

A frame is its number, counts of boxes and pairs (u32 each), boxes (min and max, f32) and pairs of indices (u32).
"""

import struct
import sys

import numpy as np
import rerun as rr

ALONE, IN_A_PAIR, LINE = (120, 130, 150), (240, 120, 60), (250, 220, 80)

rr.init("pairmaskd demo")
rr.save(sys.argv[1])
print("ready", flush=True)
read = sys.stdin.buffer.read
while head := read(12):
    frame, box_count, pair_count = struct.unpack("<3I", head)
    corners = np.frombuffer(read(24 * box_count), "<f4").reshape(-1, 2, 3)
    pairs = np.frombuffer(read(8 * pair_count), "<u4").reshape(-1, 2)
    centers, halves = corners.mean(axis=1), (corners[:, 1] - corners[:, 0]) / 2
    colors = np.tile(np.array(ALONE, np.uint8), (box_count, 1))
    colors[pairs.reshape(-1)] = IN_A_PAIR
    rr.set_time("frame", sequence=frame)
    rr.log("demo/boxes", rr.Boxes3D(centers=centers, half_sizes=halves, colors=colors))
    rr.log("demo/pairs", rr.LineStrips3D(centers[pairs], colors=[LINE]))
    rr.log("pairs", rr.Scalars(pair_count))
