"""Pairmask by its command line: scenes, exact pairs, and its own rows of the table."""

import json
import subprocess

import pair_sets


class Pairmask:
    """A `pairmaskd` binary."""

    def __init__(self, binary):
        self.binary = binary

    def _run(self, *arguments):
        done = subprocess.run(
            [self.binary, *map(str, arguments)],
            check=False,
            capture_output=True,
            text=True,
        )
        if done.returncode != 0:
            raise RuntimeError(f"pairmaskd {arguments[0]}: {done.stderr.strip()}")
        return done.stdout

    def write_scene(self, name, n, path):
        self._run("scene", name, n, path)

    def exact_pairs(self, boxes, pairs):
        """The exact pairs of a file of boxes, by a CPU engine; kept in the file `pairs`."""
        if not pairs.exists():
            self._run("cull", boxes, "--backend", "in-process", "--pairs", pairs, "--json")
        return pair_sets.read(pairs)

    def version(self):
        return self._run("--version").strip()

    def latency(self, boxes, backend, frames, warm_up, threads):
        """`bench latency` of a file of boxes, for a client of `threads` threads: its machine and its row."""
        report = json.loads(
            self._run(
                *("bench", "latency", "--scene", boxes, "--backend", backend),
                *("--frames", frames, "--warm-up", warm_up, "--decode-threads", threads, "--json"),
            )
        )
        return report["machine"], report["rows"][0]
