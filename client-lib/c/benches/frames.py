"""Times frames as tests/programs/conformance.c does, through the package for Python.

Arguments: a backend, the runtime directory, and `cull`, or `frame` for a frame in several calls.
"""

import sys
import time
from typing import Any

import numpy as np
import pairmask


def main() -> None:
    backend, folder, way = sys.argv[1:]
    given: Any = {"backend": backend, "runtime_dir": folder, "threads": 1, "answer_repeats": False}
    session = pairmask.Session(**given)

    def frame(boxes: Any) -> Any:
        frame = session.frame(len(boxes))
        frame.boxes[:] = boxes
        with frame.submit().wait() as mask:
            return mask.pairs()

    work = {"frame": frame, "cull": session.cull}[way]
    while head := sys.stdin.buffer.read(8):
        n, times = np.frombuffer(head, np.uint32).tolist()
        boxes = np.frombuffer(sys.stdin.buffer.read(24 * n), np.float32).reshape(n, 6)
        pairs = work(boxes)
        start = time.perf_counter_ns()
        for _ in range(times):
            pairs = work(boxes)
        taken = time.perf_counter_ns() - start
        sys.stdout.buffer.write(np.array([len(pairs), 0, 0, 0, taken], np.uint64).tobytes() + pairs.tobytes())
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
