"""Scenes against a naive model of them: what began, what ended and why, what there is, what queries find."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import Daemon
from pairmask import EndReason


class Model:
    """A scene that compares all boxes with all after each edit."""

    def __init__(self, most: int) -> None:
        self.boxes = np.full((most, 6), np.nan, np.float32)
        self.on = np.zeros(most, bool)
        self.static = np.zeros(most, bool)
        self.told: oracle.Pairs = set()
        self.removed: set[int] = set()

    @property
    def present(self) -> Any:
        return np.flatnonzero(~np.isnan(self.boxes[:, 0]))

    def pairs(self) -> oracle.Pairs:
        meet = self.on[:, None] & self.on[None, :] & ~(self.static[:, None] & self.static[None, :])
        return oracle.pairs_of(self.boxes, meet)

    def reason(self, a: int, b: int) -> EndReason:
        if {a, b} & self.removed:
            return EndReason.REMOVED
        if not (self.on[a] and self.on[b]) or (self.static[a] and self.static[b]):
            return EndReason.FILTERED
        return EndReason.SEPARATED

    def changes(self) -> tuple[oracle.Pairs, dict[tuple[int, int], EndReason]]:
        """What began, and what ended and why, since the answer that was last taken."""
        now = self.pairs()
        again = {pair for pair in self.told & now if set(pair) & self.removed}
        ended = (self.told - now) | again
        return (now - self.told) | again, {pair: self.reason(*pair) for pair in ended}

    def take(self) -> None:
        self.told, self.removed = self.pairs(), set()


def edit_at_random(edit: pairmask.SceneEdit, model: Model, random: Any, margin: bool) -> None:
    """Adds steps of all kinds to an edit, and does them to the model in the order of the library."""
    most = len(model.boxes)
    present = model.present

    def some(of: Any, count: int) -> Any:
        return random.choice(of, min(len(of), count), replace=False)

    removed = some(present, int(random.integers(0, 4)))
    set_ = some(np.arange(most), int(random.choice([0, 1, 5, most // 2])))
    boxes = oracle.boxes_of(most, int(random.integers(1 << 30)), spread=0.6)[: len(set_)]
    switched = some(np.setdiff1d(np.union1d(present, set_), np.setdiff1d(removed, set_)), 3)
    on, static = bool(random.integers(2)), bool(random.integers(2))
    edit.remove(removed)
    edit.set(set_, boxes, *([0.2] if margin else []))
    edit.switch(switched, on)
    edit.make_static(switched[:1], static)
    model.boxes[removed] = np.nan
    model.on[removed] = model.static[removed] = False
    model.removed |= set(removed.tolist())
    new = np.isnan(model.boxes[set_, 0])
    model.boxes[set_] = boxes
    model.on[set_[new]] = True
    model.static[set_[new]] = False
    model.on[switched] = on
    model.static[switched[:1]] = static


def check_answer(answer: pairmask.SceneAnswer, model: Model) -> None:
    assert answer.pair_count == len(model.pairs())
    if answer.is_resync:
        oracle.check(answer.pairs, model.pairs())
        return
    begun, ended = model.changes()
    oracle.check(answer.begun, begun)
    told = dict(zip(map(tuple, answer.ended.tolist()), map(EndReason, answer.ended_reasons.tolist()), strict=True))
    assert told == ended
    for pairs in (answer.begun, answer.ended):
        assert np.array_equal(pairs, np.array(sorted(map(tuple, pairs.tolist())), np.uint32).reshape(-1, 2))
        assert not pairs.flags.writeable


def run_scene(scene: Any, random: Any, edits: int, margin: bool = False) -> None:
    model = Model(60)
    for step in range(edits):
        edit = scene.edit()
        edit_at_random(edit, model, random, margin)
        report = random.choice(["changes", "changes", "changes", "all", "nothing"])
        if random.random() < 0.2:
            # An answer that nobody waits for: the next one makes up for it.
            edit.submit(report).close()
            continue
        answer = edit.commit(report)
        assert len(scene) == len(model.present)
        if report == "all":
            oracle.check(answer.pairs, model.pairs(), step)
        elif report == "changes":
            check_answer(answer, model)
        else:
            assert answer.pair_count is None and len(answer.pairs) == 0
        if report != "nothing":
            model.take()


def test_scenes_in_process(session: pairmask.Session) -> None:
    for seed in range(6):
        run_scene(session.scene(most_boxes=100), np.random.default_rng(seed), 60)


def test_margined_scenes_in_process(session: pairmask.Session) -> None:
    for seed in range(4):
        run_scene(session.scene(margins="exact", usual_margin=0.1), np.random.default_rng(seed), 40, margin=True)


def test_scenes_by_a_daemon_that_is_killed_meanwhile(daemon: Daemon) -> None:
    with daemon.session("auto") as session:
        scene, margined = session.scene(), session.scene(margins="exact", usual_margin=0.1)
        random = np.random.default_rng(9)
        run_scene(scene, random, 30)
        run_scene(margined, random, 30, margin=True)
        boxes = oracle.boxes_of(500, 1)
        other = session.scene()
        assert other.edit().set(range(500), boxes).commit().served_by == "daemon"
        daemon.kill()
        answer = other.edit().set(0, boxes[1]).commit("all")
        assert answer.served_by == "in-process"
        boxes[0] = boxes[1]
        oracle.check(answer.pairs, oracle.pairs_of(boxes))


def test_near_pairs_and_what_is_sent(session: pairmask.Session) -> None:
    scene = session.scene(margins="near")

    def at(x: float) -> Any:
        return np.array([[x, 0, 0, x + 1, 1, 1]], np.float32)

    scene.edit().set(0, at(0), 0.5).set(1, at(1.2), [0.5]).commit()
    assert scene.edit().set(1, at(1.3), 0.5).commit().begun.tolist() == []
    stats = scene.margin_stats
    assert stats is not None
    assert (stats.edits, stats.requests, stats.set, stats.sent) == (2, 1, 3, 2)
    inflated = scene.inflated(0)
    assert inflated is not None and inflated[0] <= -0.5
    # Queries are of the boxes as they were set.
    assert scene.query(at(1.05)).tolist() == [[0, 1]]
    assert scene.edit().tag(0, world=1).tag(1, world=2).commit().ended.tolist() == [[0, 1]]
    for wrong in (-1.0, float("nan"), [0.1, 0.2]):
        with pytest.raises((ValueError, pairmask.PairmaskError)):
            scene.edit().set(0, at(0), wrong).commit()


def test_moved_tells_the_pairs_of_what_moved(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(200, 2)
    scene = session.scene()
    scene.edit().set(range(200), boxes).commit("nothing")
    boxes[[3, 7]] = boxes[[10, 11]]
    answer = scene.edit().set([3, 7], boxes[[3, 7]]).commit("moved")
    oracle.check(answer.pairs, {pair for pair in oracle.pairs_of(boxes) if {3, 7} & set(pair)})


def test_indices_of_all_kinds(session: pairmask.Session) -> None:
    scene = session.scene()
    boxes = oracle.boxes_of(10, 3)
    mask = np.zeros(10, bool)
    mask[[8, 9]] = True
    edit = scene.edit().set(0, boxes[0]).set(range(1, 4), boxes[1:4]).set([4, 5], boxes[4:6])
    edit.set(np.array([6, 7]), boxes[6:8]).set(mask, boxes[8:]).set([], [])
    oracle.check(edit.commit("all").pairs, oracle.pairs_of(boxes))
    box = scene.get(5)
    assert box is not None and np.array_equal(box, boxes[5]) and scene.get(10) is None
    scene.edit().remove(range(0, 10, 2)).commit()
    assert len(scene) == 5 and bool(scene)
    for wrong in (-1, 2**32, range(-1, 3), [0, -1], [2**32]):
        with pytest.raises(ValueError):
            scene.edit().remove(wrong)
    for typed in (True, 0.5, [0.5], "a"):
        with pytest.raises(TypeError):
            scene.edit().remove(typed)


def test_what_is_wrong_with_edits(session: pairmask.Session) -> None:
    scene = session.scene(most_boxes=50)
    boxes = oracle.boxes_of(3, 4)
    scene.edit().set(range(3), boxes).commit()
    edits: dict[str, Any] = {
        "beyond the 50 boxes": lambda e: e.set(50, boxes[0]),
        "give one for each": lambda e: e.set(range(3), boxes[:2]),
        "set twice": lambda e: e.set([1, 1], boxes[:2]),
        "has no box": lambda e: e.remove(9),
        "index 9 has no box": lambda e: e.tag(9, world=1),
    }
    for text, wrong in edits.items():
        with pytest.raises(pairmask.PairmaskError, match=text) as caught:
            wrong(scene.edit()).commit()
        assert caught.value.kind == "Edit"
    oracle.check(scene.edit().commit("all").pairs, oracle.pairs_of(boxes))
    edit = scene.edit()
    edit.commit()
    for use in (edit.commit, lambda: edit.remove(0)):
        with pytest.raises(pairmask.PairmaskError, match="committed"):
            use()
    with pytest.raises(ValueError, match="changes, moved, all or nothing"):
        scene.edit().commit("some")  # type: ignore[arg-type]
    with pytest.raises(pairmask.PairmaskError, match="no margins"):
        scene.edit().set(0, boxes[0], margin=0.5).commit()
    scene.close()
    with pytest.raises(pairmask.PairmaskError, match="closed"):
        scene.edit().commit()


def test_rules_of_scenes(session: pairmask.Session) -> None:
    boxes = np.tile(np.array([0, 0, 0, 1, 1, 1], np.float32), (6, 1))
    scene = session.scene()
    table = pairmask.FilterTable([pairmask.Filter(1, 2), pairmask.Filter(2, 3)])
    edit = scene.edit().set(range(6), boxes).filters(table).tag(range(6), world=[0, 0, 1, 1, -1, 1], filter=1)
    found = {(0, 1), (2, 3), (2, 5), (3, 5), *((a, 4) for a in range(4)), (4, 5)}
    oracle.check(edit.commit("all").pairs, found)
    answer = scene.edit().exclude([[0, 1], [2, 3]]).include([4, 0]).commit()
    assert answer.ended.tolist() == [[0, 1], [2, 3]]
    assert set(answer.ended_reasons.tolist()) == {EndReason.FILTERED}
    answer = scene.edit().exclude([[0, 1]], on=False).tag([2, 3], world=1, filter=0).commit()
    assert answer.begun.tolist() == [[0, 1]]
    assert [2, 3] not in answer.begun.tolist()
    assert len(scene.query(boxes[:1], world=1, filter=1)) == 4
    assert scene.query(boxes[:2], world=[0, 1], filter=1)[:, 1].tolist() == [0, 1, 4, 2, 3, 4, 5]


def test_queries(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(300, 5)
    scene = session.scene()
    scene.edit().set(range(300), boxes).commit("nothing")
    asked = oracle.boxes_of(40, 6, spread=2)
    found = scene.query(asked)
    assert found.tolist() == np.argwhere(oracle.overlapping(asked, boxes)).tolist()
    centres = (boxes[:, :3] + boxes[:, 3:]) / 2
    points = pairmask.points(centres)
    assert np.array_equal(points, np.hstack([centres, centres]))
    assert {(a, a) for a in range(300)} <= set(map(tuple, scene.query(points).tolist()))
    moved = asked + np.float32(2)
    swept = pairmask.swept(asked, moved)
    assert np.array_equal(swept, np.hstack([np.minimum(asked, moved)[:, :3], np.maximum(asked, moved)[:, 3:]]))
    by = pairmask.swept_by(asked, np.full((40, 3), 2, np.float32))
    assert (by[:, 3:] >= asked[:, 3:] + 2).all() and (by[:, :3] == asked[:, :3]).all()
    assert scene.query(asked[0]).shape[1] == 2 and scene.query(np.zeros((0, 6))).shape == (0, 2)
    with pytest.raises(ValueError):
        pairmask.swept(asked, moved[:3])
    with pytest.raises(ValueError, match="round it yourself"):
        pairmask.points([[0.1, 0, 0]])
    with pytest.raises(ValueError, match="give one for each"):
        scene.query(asked, world=[1, 2])


def test_an_answer_that_nobody_waits_for_is_reported_again(session: pairmask.Session) -> None:
    scene = session.scene()
    boxes = oracle.boxes_of(50, 7)
    scene.edit().set(range(50), boxes).submit().close()
    oracle.check(scene.edit().commit().begun, oracle.pairs_of(boxes))
    assert len(scene.edit().commit().begun) == 0
    scene.resync()
    assert scene.edit().commit().is_resync
    assert scene.allocated_bytes > 0
