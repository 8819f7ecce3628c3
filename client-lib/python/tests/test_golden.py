"""The golden scenes of the Rust conformance suite through Python: same pairs, by hash, pair by pair.

`tests/golden-scenes.txt` of the repository names them, and `tests/tests/engines_agree.rs` holds the Rust engines to
the same lines. The daemon's program writes their boxes.
"""

from __future__ import annotations

import subprocess

import numpy as np
import oracle
import pairmask
from conftest import ROOT, Daemon, pairmaskd


def test_golden_scenes_have_their_pairs(daemon: Daemon, session: pairmask.Session) -> None:
    text = (ROOT / "tests/golden-scenes.txt").read_text()
    golden = [line.split() for line in text.splitlines() if not line.startswith("#")]
    assert len(golden) == 13
    for name, n, seed, pairs in golden:
        command = [pairmaskd(), "scene", name, n, "-", "--seed", seed]
        written = subprocess.run(command, capture_output=True, check=True).stdout
        boxes = np.frombuffer(written, "<f4").reshape(int(n), 6)
        expected = oracle.pairs_of(boxes)
        assert oracle.hash_of(expected) == int(pairs, 16), f"the oracle: {oracle.hash_of(expected):#018x}"
        oracle.check(session.cull(boxes), expected, name)
        with daemon.session() as other, other.scene() as scene:
            oracle.check(other.cull(boxes), expected, name)
            answer = scene.edit().set(range(int(n)), boxes).commit()
            told = answer.pairs if answer.is_resync else answer.begun
            assert np.array_equal(told, np.array(sorted(expected), np.uint32).reshape(-1, 2)), name
