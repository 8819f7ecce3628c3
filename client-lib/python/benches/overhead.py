"""What Python adds to a frame: numpy in, numpy out, against the same frames in Rust, in turns.

    python benches/overhead.py                      in process
    python benches/overhead.py --runtime-dir DIR    by the daemon that serves there

Both sides run short turns of frames one after another, so that a machine that is not quiet is as loud for both.
What is printed are medians of the turns' medians, their quartiles, and the median of the differences of turns that
follow each other. Needs the package, and cargo for the Rust side.
"""

from __future__ import annotations

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


def boxes_of(n: int) -> Any:
    """Boxes with about a pair each."""
    random = np.random.default_rng(1)
    low = random.random((n, 3)) * (2 * n) ** (1 / 3)
    return np.hstack([low, low + 1]).astype(np.float32)


def rust_side(file: pathlib.Path, backend: str, folder: str, frames: int) -> Callable[[], float]:
    command = ["cargo", "bench", "--quiet", "--locked", "--bench", "rust_frame", "--"]
    command += [str(file), backend, folder, str(frames)]
    process = subprocess.Popen(command, cwd=FOLDER, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    to, from_ = process.stdin, process.stdout
    assert to is not None and from_ is not None

    def turn() -> float:
        to.write("\n")
        to.flush()
        return int(from_.readline()) / 1e3

    return turn


def python_side(work: Callable[[], object], frames: int) -> Callable[[], float]:
    def turn() -> float:
        times = []
        for _ in range(frames):
            begun = time.perf_counter_ns()
            work()
            times.append(time.perf_counter_ns() - begun)
        return statistics.median(times) / 1e3

    return turn


def main() -> None:
    parser = argparse.ArgumentParser(description="What Python adds to a frame, in turns with Rust")
    parser.add_argument("--n", type=int, default=1000, help="boxes of a frame")
    parser.add_argument("--frames", type=int, default=100, help="frames of a turn")
    parser.add_argument("--turns", type=int, default=200, help="turns of each side")
    parser.add_argument("--runtime-dir", help="ask the daemon that serves there")
    given = parser.parse_args()
    boxes = boxes_of(given.n)
    backend: Any = "daemon" if given.runtime_dir else "in-process"
    options: dict[str, Any] = {"runtime_dir": given.runtime_dir} if given.runtime_dir else {}
    session = pairmask.Session(backend, threads=1, answer_repeats=False, **options)

    def cull() -> object:
        return session.cull(boxes)

    def frame() -> object:
        frame = session.frame(given.n)
        frame.boxes[:] = boxes
        with frame.submit().wait() as mask:
            return mask.pairs()

    with tempfile.NamedTemporaryFile(suffix=".f32") as file:
        file.write(boxes.tobytes())
        file.flush()
        sides = {
            "Rust": rust_side(pathlib.Path(file.name), backend, given.runtime_dir or "-", given.frames),
            "Python, session.cull": python_side(cull, given.frames),
            "Python, frame by frame": python_side(frame, given.frames),
        }
        for turn in sides.values():
            turn()
        turns: dict[str, list[float]] = {name: [] for name in sides}
        for _ in range(given.turns):
            for name, turn in sides.items():
                turns[name].append(turn())
    pairs = len(session.cull(boxes))
    print(f"{given.n} boxes, {pairs} pairs, {backend}, one thread, {given.turns} turns of {given.frames} frames; us")
    print(f"numpy {np.__version__}, Python {sys.version.split()[0]}")
    print(f"{'':24}{'median':>8}{'quartiles':>16}{'over Rust':>11}{'quartiles':>14}")
    for name, times in turns.items():
        low, median, high = statistics.quantiles(times, n=4)
        over = [time - rust for time, rust in zip(times, turns["Rust"], strict=True)]
        over_low, over_median, over_high = statistics.quantiles(over, n=4)
        print(
            f"{name:24}{median:8.1f}{f'{low:.1f} {high:.1f}':>16}{over_median:11.1f}{f'{over_low:.1f} {over_high:.1f}':>14}"
        )


if __name__ == "__main__":
    main()
