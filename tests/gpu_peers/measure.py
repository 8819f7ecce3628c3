"""One peer over all scenes, in a process of its own: a fault of its ends no other's run.

Called by `__main__.py`. Prints one JSON object a row.
"""

import argparse
import gc
import json
import statistics
import sys
from pathlib import Path

import numpy as np
import warp as wp

import pair_sets
import scenes
from contenders import all_contenders
from frames import Frames, Times
from pairmask import Pairmask


def milliseconds(seconds):
    return round(1e3 * statistics.median(seconds), 4) if seconds else None


def measure(name, contender, scene_name, boxes, options, pairmask):
    """A row: frames in motion, timed, and the pairs of the first and the last held to the exact."""
    lower, upper = scenes.read(boxes)
    n = len(lower)
    row = {"contender": name, "scene": scene_name, "n": n}
    most = getattr(contender, "most_boxes", None)
    if most is not None and n > most:
        return row | {"error": f"not run beyond {most} boxes"}
    frames = Frames(contender, n, options.device, lower, upper)
    scene = scenes.Scene(lower, upper)
    frames.whole_frame(lower, upper)
    first = check(frames, boxes, boxes.with_suffix(".pairs"), pairmask)
    times = Times()
    last_lower, last_upper = np.empty_like(lower), np.empty_like(upper)
    for frame in range(options.warm_up + options.frames + options.split_frames):
        np.copyto(last_lower, scene.lower)
        np.copyto(last_upper, scene.upper)
        scene.step()
        # Moving the boxes took a while: an untimed frame wakes the GPU's clocks again.
        frames.whole_frame(last_lower, last_upper)
        if frame < options.warm_up:
            frames.whole_frame(scene.lower, scene.upper)
        elif frame < options.warm_up + options.frames:
            frames.whole_frame(scene.lower, scene.upper, times)
        else:
            frames.split_frame(scene.lower, scene.upper, times)
    last_boxes = boxes.with_suffix(".last.f32")
    scenes.write(last_boxes, scene.lower, scene.upper)
    last = check(frames, last_boxes, boxes.with_suffix(".last.pairs"), pairmask)
    return row | {
        "frames": len(times.total),
        "is_recorded": frames.is_recorded,
        "write_ms": milliseconds(times.write),
        "device_ms": milliseconds(times.device),
        "copy_ms": milliseconds(times.copy),
        "iterate_ms": milliseconds(times.iterate),
        "total_ms": milliseconds(times.total),
        "total_p90_ms": round(1e3 * float(np.quantile(times.total, 0.9)), 4),
        "with_write_ms": milliseconds(times.with_write),
        "first": first,
        "last": last,
        "error": None,
    }


def check(frames, boxes, pairs, pairmask):
    """What is wrong with the pairs of the frame just done."""
    found, counted = frames.found_pairs()
    difference = pair_sets.compare(pair_sets.keys(found), pairmask.exact_pairs(boxes, pairs))
    return {
        "expected": difference.expected,
        "counted": counted,
        "capacity": frames.capacity,
        "missed": difference.missed,
        "extra": difference.extra,
        "repeated": difference.repeated,
        "is_exact": difference.is_exact,
    }


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--contender", required=True)
    parser.add_argument("--device", required=True)
    parser.add_argument("--pairmaskd", required=True)
    parser.add_argument("--frames", type=int, required=True)
    parser.add_argument("--warm-up", type=int, required=True)
    parser.add_argument("--split-frames", type=int, required=True)
    parser.add_argument("scene", nargs="+", help="NAME=FILE")
    options = parser.parse_args()
    wp.config.quiet = True
    wp.init()
    pairmask = Pairmask(options.pairmaskd)
    for named in options.scene:
        scene_name, path = named.split("=", 1)
        # One row's failure (a builder that is not there, memory) is that row's.
        try:
            contender = all_contenders()[options.contender]
            row = measure(
                options.contender, contender, scene_name, Path(path), options, pairmask
            )
        except Exception as error:  # noqa: BLE001
            text = " ".join(str(error).split())[:300]
            n = Path(path).stat().st_size // 24
            row = {"contender": options.contender, "scene": scene_name, "n": n, "error": text}
        print(json.dumps(row), flush=True)
        contender = None
        gc.collect()


if __name__ == "__main__":
    sys.exit(main())
