"""The golden scenes of the Rust conformance suite through Python: same pairs, by hash, pair by pair.

`tests/golden-scenes.txt` of the repository names them, and `tests/tests/engines_agree.rs` holds the Rust engines to
the same lines. The daemon's program writes their boxes.
"""

from __future__ import annotations

import subprocess
from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import ROOT, Daemon, pairmaskd


def golden_scenes() -> list[tuple[str, int, int, int]]:
    """Name, number of boxes, seed and the hash of the pairs of each golden scene."""
    with open(ROOT / "tests/golden-scenes.txt") as file:
        lines = [line.split() for line in file if not line.startswith("#")]
    return [(name, int(n), int(seed), int(pairs, 16)) for name, n, seed, pairs in lines]


GOLDEN = golden_scenes()


def boxes_of(name: str, n: int, seed: int) -> Any:
    command = [pairmaskd(), "scene", name, str(n), "-", "--seed", str(seed)]
    written = subprocess.run(command, capture_output=True, check=True).stdout
    return np.frombuffer(written, "<f4").reshape(n, 6)


def test_there_are_golden_scenes() -> None:
    assert len(GOLDEN) == 13


@pytest.mark.parametrize(("name", "n", "seed", "golden"), GOLDEN)
def test_golden_scenes_have_their_pairs(name: str, n: int, seed: int, golden: int) -> None:
    boxes = boxes_of(name, n, seed)
    expected = oracle.pairs_of(boxes)
    assert oracle.hash_of(expected) == golden, f"the oracle: {oracle.hash_of(expected):#018x}"
    engines: list[Any] = ["auto", "cpu-brute", "cpu-sap", "cpu-grid", "cpu-tree"]
    encodings: list[Any] = ["auto", "dense", "sparse", "list"]
    for engine in engines:
        for encoding in encodings:
            for threads in (1, 2):
                with pairmask.Session("in-process", engine=engine, encoding=encoding, threads=threads) as session:
                    oracle.check(session.cull(boxes), expected, (engine, encoding, threads))


def test_golden_scenes_have_their_pairs_by_a_daemon_and_as_scenes(daemon: Daemon) -> None:
    with daemon.session("daemon") as session:
        for name, n, seed, golden in GOLDEN:
            boxes = boxes_of(name, n, seed)
            found = oracle.as_set(session.cull(boxes))
            assert oracle.hash_of(found) == golden, name
            with session.scene() as scene:
                answer = scene.edit().set(range(n), boxes).commit()
                told = answer.pairs if answer.is_resync else answer.begun
                oracle.check(told, found, name)
                assert np.array_equal(told, np.array(sorted(found), np.uint32).reshape(-1, 2)), "sorted"
