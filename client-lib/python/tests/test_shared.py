"""Shared scenes: two sessions write one scene, each its own boxes."""

from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import UNIT, Daemon, kind_of

def test_moved_pairs_and_queries_are_of_all_members(daemon: Daemon) -> None:
    with daemon.session() as session, daemon.session() as other:
        boxes = oracle.boxes_of(60, 3)
        scenes = [
            s.join_scene("asked", scope="all", tick_deadline=10, usual_margin=margin)
            for s, margin in ((session, None), (other, 0.0))
        ]
        for at, scene in enumerate(scenes):
            scene.lease(range(30 * at, 30 * at + 30))

        def tick(moved: dict[int, object]) -> list[oracle.Pairs]:
            """Both members commit on this thread, neither waits before the other has submitted: what moved."""
            for index, box in moved.items():
                boxes[index] = box
            pending = []
            for at, scene in enumerate(scenes):
                own = [index for index in moved if index // 30 == at]
                pending.append(scene.edit().set(own, boxes[own]).submit("moved"))
            assert kind_of(lambda: scenes[0].leases) == "UnderWay"
            answers = [one.wait() for one in pending]
            assert len({answer.tick for answer in answers}) == 1 and not any(answer.late for answer in answers)
            return [oracle.as_set(answer.pairs) for answer in answers]

        assert tick(dict(enumerate(boxes.copy()))) == 2 * [oracle.pairs_of(boxes)]
        moved = {3: boxes[40], 31: boxes[4], 32: boxes[5]}
        assert tick(moved) == 2 * [{pair for pair in oracle.pairs_of(boxes) if moved.keys() & set(pair)}]
        stats = scenes[1].margin_stats
        assert scenes[0].margin_stats is None and stats is not None and stats.sent == 32
        expected = np.argwhere(oracle.overlapping(boxes[:20], boxes)).tolist()
        assert [scene.query(boxes[:20]).tolist() for scene in scenes] == 2 * [expected]


def test_a_writer_that_is_late_is_named(daemon: Daemon) -> None:
    with daemon.session() as session, daemon.session() as other:
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
    with daemon.session() as session:
        scene = session.join_scene("a", most_boxes=100, at_end="keep")
        scene.lease(range(0, 10))
        assert kind_of(lambda: session.join_scene("no spaces")) == "SceneName"
        assert kind_of(lambda: session.join_scene("a", most_boxes=7)) == "TermsDiffer"
        assert kind_of(lambda: scene.lease(range(5, 20))) == "Lease"
        assert kind_of(lambda: scene.lease(range(5, 5))) == "Lease"
        assert kind_of(lambda: scene.edit().set(10, UNIT).commit()) == "NotLeased"
        wrong: list[tuple[Any, type[Exception], str | None]] = [
            (lambda: scene.edit().set([1, 1], [UNIT] * 2).commit(), pairmask.PairmaskError, "set twice"),
            (lambda: scene.lease(range(20, 30, 2)), ValueError, "gaps"),
            (lambda: scene.lease(range(-1, 5)), OverflowError, None),
            (lambda: scene.lease((20, 30)), TypeError, None),  # type: ignore[arg-type]
            (lambda: session.join_scene("b", scope="some"), ValueError, "own, all"),  # type: ignore[arg-type]
            (lambda: session.join_scene("b", at_end="burn"), ValueError, "keep"),  # type: ignore[arg-type]
            (lambda: session.join_scene("b", usual_margin=-1), ValueError, None),
        ]
        for call, error, text in wrong:
            with pytest.raises(error, match=text):
                call()
