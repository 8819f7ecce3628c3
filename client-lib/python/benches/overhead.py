"""What Python adds to a frame: numpy in, numpy out, against the same frames in Rust, in turns.

    python benches/overhead.py                      in process
    python benches/overhead.py --runtime-dir DIR    by the daemon that serves there

Both sides run short turns of frames one after another, so that a machine that is not quiet is as loud for both.
What is printed are medians of the turns' medians, their quartiles, and the median of the differences of turns that
follow each other. Needs the package, and cargo for the Rust side.
"""

import argparse
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pairmask

FOLDER = pathlib.Path(__file__).resolve().parent.parent
BOXES = 1000
# Frames of a turn, and turns of each side: a turn is short, so that what disturbs one side disturbs the others.
FRAMES, TURNS = 100, 200


def rust_side(file: str, backend: str, folder: str) -> Callable[[], float]:
    command = ["cargo", "bench", "--quiet", "--locked", "--bench", "rust_frame", "--"]
    command += [file, backend, folder, str(FRAMES)]
    process = subprocess.Popen(command, cwd=FOLDER, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    to, from_ = process.stdin, process.stdout
    assert to is not None and from_ is not None

    def turn() -> float:
        to.write("\n")
        to.flush()
        return int(from_.readline()) / 1e3

    return turn


def python_side(work: Callable[[], object]) -> Callable[[], float]:
    def turn() -> float:
        times = []
        for _ in range(FRAMES):
            begun = time.perf_counter_ns()
            work()
            times.append(time.perf_counter_ns() - begun)
        return statistics.median(times) / 1e3

    return turn


def spread(times: list[float]) -> str:
    low, median, high = statistics.quantiles(times, n=4)
    return f"{median:8.1f} ({low:.1f} {high:.1f})"


def main() -> None:
    parser = argparse.ArgumentParser(description="What Python adds to a frame, in turns with Rust")
    parser.add_argument("--runtime-dir", help="ask the daemon that serves there")
    folder = parser.parse_args().runtime_dir
    random = np.random.default_rng(1)
    low = random.random((BOXES, 3)) * (2 * BOXES) ** (1 / 3)
    boxes = np.hstack([low, low + 1]).astype(np.float32)
    backend: Any = "daemon" if folder else "in-process"
    session = pairmask.Session(backend, runtime_dir=folder, threads=1, answer_repeats=False)

    def frame() -> object:
        frame = session.frame(BOXES)
        frame.boxes[:] = boxes
        with frame.submit().wait() as mask:
            return mask.pairs()

    with tempfile.NamedTemporaryFile(suffix=".f32") as file:
        file.write(boxes.tobytes())
        file.flush()
        sides = {
            "Rust": rust_side(file.name, backend, folder or "-"),
            "Python, session.cull": python_side(lambda: session.cull(boxes)),
            "Python, frame by frame": python_side(frame),
        }
        turns = [{name: turn() for name, turn in sides.items()} for _ in range(1 + TURNS)][1:]
    pairs = len(session.cull(boxes))
    print(f"{BOXES} boxes, {pairs} pairs, {backend}, one thread, {TURNS} turns of {FRAMES} frames")
    print(f"numpy {np.__version__}, Python {sys.version.split()[0]}; us: median (quartiles)")
    for name in sides:
        times = spread([turn[name] for turn in turns])
        print(f"{name:24}{times}, over Rust {spread([turn[name] - turn['Rust'] for turn in turns])}")


if __name__ == "__main__":
    main()
