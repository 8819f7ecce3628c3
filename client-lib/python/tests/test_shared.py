"""Shared scenes: two processes write one scene, each its own boxes."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import oracle
import pairmask
import pytest
from conftest import PATIENCE, Daemon

WRITER = """
import sys, numpy as np, oracle, pairmask
folder, first, count, ticks = sys.argv[1], *map(int, sys.argv[2:])
session = pairmask.Session("daemon", runtime_dir=folder)
scene = session.join_scene("arena", scope="all", tick_deadline=10)
scene.lease(range(first, first + count))
print("joined", flush=True)
sys.stdin.readline()
for tick in range(ticks):
    boxes = oracle.boxes_of(400, tick)[first : first + count]
    answer = scene.edit().set(range(first, first + count), boxes).commit("all")
    print(answer.tick, oracle.hash_of(oracle.as_set(answer.pairs)), len(answer.late), flush=True)
"""


def test_two_processes_write_one_scene(daemon: Daemon) -> None:
    ticks = 5
    writers = []
    for first, count in ((0, 150), (150, 250)):
        command = [sys.executable, "-c", WRITER, str(daemon.folder), str(first), str(count), str(ticks)]
        writer = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=__file__.rpartition("/")[0]
        )
        writers.append(writer)
    for writer in writers:
        assert writer.stdout is not None and writer.stdout.readline() == "joined\n"
    for writer in writers:
        assert writer.stdin is not None
        writer.stdin.write("go\n")
        writer.stdin.flush()
    expected = [[t + 1, oracle.hash_of(oracle.pairs_of(oracle.boxes_of(400, t))), 0] for t in range(ticks)]
    for writer in writers:
        told, _ = writer.communicate(timeout=PATIENCE)
        assert [list(map(int, line.split())) for line in told.splitlines()] == expected


def test_moved_pairs_and_queries_are_of_all_members(daemon: Daemon) -> None:
    with daemon.session("daemon") as session, daemon.session("daemon") as other:
        boxes = oracle.boxes_of(60, 3)
        scenes = [
            s.join_scene("asked", scope="all", tick_deadline=10, usual_margin=margin)
            for s, margin in ((session, None), (other, 0.0))
        ]
        for at, scene in enumerate(scenes):
            scene.lease(range(30 * at, 30 * at + 30))

        def tick(moved: dict[int, object]) -> list[oracle.Pairs]:
            """Both members commit: the pairs of what moved."""
            for index, box in moved.items():
                boxes[index] = box
            pending = []
            for at, scene in enumerate(scenes):
                own = [index for index in moved if index // 30 == at]
                pending.append(scene.edit().set(own, boxes[own]).submit("moved"))
            return [oracle.as_set(one.wait().pairs) for one in pending]

        assert tick(dict(enumerate(boxes.copy()))) == 2 * [oracle.pairs_of(boxes)]
        moved = {3: boxes[40], 31: boxes[4], 32: boxes[5]}
        told = tick(moved)
        assert told == 2 * [{pair for pair in oracle.pairs_of(boxes) if moved.keys() & set(pair)}]
        stats = scenes[1].margin_stats
        assert scenes[0].margin_stats is None and stats is not None and stats.sent == 32
        expected = np.argwhere(oracle.overlapping(boxes[:20], boxes)).tolist()
        assert [scene.query(boxes[:20]).tolist() for scene in scenes] == 2 * [expected]


def test_a_writer_that_is_late_is_named(daemon: Daemon) -> None:
    with daemon.session("daemon") as session, daemon.session("daemon") as other:
        scene = session.join_scene("late", tick_deadline=0.05, most_boxes=1000, scope="all")
        late = other.join_scene("late")
        assert late.most_boxes == 1000 and late.tick_deadline == pytest.approx(0.05)
        assert scene.lease_any(10) == range(10)
        late.lease(range(10, 20))
        assert scene.leases == [range(10)] and late.leases == [range(10, 20)]
        answer = scene.edit().set(range(10), np.zeros((10, 6), np.float32)).commit()
        assert answer.late == [range(10, 20)] and answer.tick == 1 and answer.pair_count == 45
        assert len(scene) == 10 and scene.get(3) is not None and scene.get(10) is None
        scene.give_back(0)
        assert scene.leases == [] and len(scene) == 0


def test_what_is_wrong_with_shared_scenes(daemon: Daemon) -> None:
    def kind(call: object) -> str:
        assert callable(call)
        with pytest.raises(pairmask.PairmaskError) as caught:
            call()
        return caught.value.kind

    with daemon.session("daemon") as session:
        scene = session.join_scene("a", most_boxes=100)
        scene.lease(range(0, 10))
        assert kind(lambda: session.join_scene("no spaces")) == "SceneName"
        assert kind(lambda: session.join_scene("a", most_boxes=7)) == "TermsDiffer"
        assert kind(lambda: scene.lease(range(5, 20))) == "Lease"
        assert kind(lambda: scene.lease(range(5, 5))) == "Lease"
        assert kind(lambda: scene.edit().set(10, [0, 0, 0, 1, 1, 1]).commit()) == "NotLeased"
        with pytest.raises(pairmask.PairmaskError, match="set twice"):
            scene.edit().set([1, 1], np.zeros((2, 6))).commit()
        with pytest.raises(ValueError, match="gaps"):
            scene.lease(range(20, 30, 2))
        with pytest.raises(OverflowError):
            scene.lease(range(-1, 5))
        with pytest.raises(TypeError):
            scene.lease((20, 30))  # type: ignore[arg-type]
        with pytest.raises(ValueError):
            session.join_scene("b", scope="some")  # type: ignore[arg-type]
        with pytest.raises(ValueError):
            session.join_scene("b", at_end="burn")  # type: ignore[arg-type]
    with pairmask.Session("in-process") as here:
        assert kind(lambda: here.join_scene("a")) == "NeedsDaemon"
