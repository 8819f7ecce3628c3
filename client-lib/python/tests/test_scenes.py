"""Scenes against a naive model of them: what began, what ended and why, what there is, what queries find."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import UNIT, Daemon, kind_of
from pairmask import EndReason, Filter, FilterTable

# Options of a scene, and the margin that its boxes are set with beside.
MARGINS = pytest.mark.parametrize(
    ("options", "margin"),
    [({}, []), ({"margins": "exact", "usual_margin": 0.1}, [0.2]), ({"margins": "near"}, [0.0])],
)


class Model:
    """A scene that compares all boxes with all after each edit."""

    def __init__(self, most: int) -> None:
        self.boxes = np.full((most, 6), np.nan, np.float32)
        self.on = np.zeros(most, bool)
        self.static = np.zeros(most, bool)
        self.told: oracle.Pairs = set()
        self.removed: set[int] = set()

    def present(self) -> Any:
        return np.flatnonzero(~np.isnan(self.boxes[:, 0]))

    def edit(self, edit: pairmask.SceneEdit, random: Any, margin: list[float]) -> None:
        """Adds steps of all kinds to an edit, and does them here in the order of the library."""
        most, present = len(self.boxes), self.present()

        def some(of: Any, count: int) -> Any:
            return random.choice(of, min(len(of), count), replace=False)

        removed = some(present, int(random.integers(0, 4)))
        set_ = some(np.arange(most), int(random.choice([0, 1, 5, most // 2])))
        boxes = oracle.boxes_of(most, int(random.integers(1 << 30)), spread=0.6)[: len(set_)]
        switched = some(np.setdiff1d(np.union1d(present, set_), np.setdiff1d(removed, set_)), 3)
        on, static = bool(random.integers(2)), bool(random.integers(2))
        edit.remove(removed).set(set_, boxes, *margin).switch(switched, on).make_static(switched[:1], static)
        self.boxes[removed] = np.nan
        self.on[removed] = self.static[removed] = False
        self.removed |= set(removed.tolist())
        new = np.isnan(self.boxes[set_, 0])
        self.boxes[set_] = boxes
        self.on[set_[new]] = True
        self.static[set_[new]] = False
        self.on[switched] = on
        self.static[switched[:1]] = static

    def pairs(self) -> oracle.Pairs:
        meet = self.on[:, None] & self.on[None, :] & ~(self.static[:, None] & self.static[None, :])
        return oracle.pairs_of(self.boxes, meet)

    def reason(self, a: int, b: int) -> EndReason:
        if {a, b} & self.removed:
            return EndReason.REMOVED
        if not (self.on[a] and self.on[b]) or (self.static[a] and self.static[b]):
            return EndReason.FILTERED
        return EndReason.SEPARATED

    def check(self, answer: pairmask.SceneAnswer, report: str) -> None:
        """Compares an answer with what began, and what ended and why, since the one before."""
        now = self.pairs()
        if report == "nothing":
            assert answer.pair_count is None and len(answer.pairs) == 0
            return
        assert answer.pair_count == len(now)
        if report == "all" or answer.is_resync:
            oracle.check(answer.pairs, now)
        else:
            again = {pair for pair in self.told & now if set(pair) & self.removed}
            oracle.check(answer.begun, (now - self.told) | again)
            reasons = map(EndReason, answer.ended_reasons.tolist())
            ended = dict(zip(map(tuple, answer.ended.tolist()), reasons, strict=True))
            assert ended == {pair: self.reason(*pair) for pair in (self.told - now) | again}
            for pairs in (answer.begun, answer.ended):
                assert pairs.tolist() == sorted(pairs.tolist())
        self.told, self.removed = now, set()


def run_scene(scene: pairmask.Scene, seed: int, edits: int, margin: list[float]) -> None:
    model, random = Model(60), np.random.default_rng(seed)
    for _ in range(edits):
        edit = scene.edit()
        model.edit(edit, random, margin)
        report = random.choice(["changes", "changes", "changes", "all", "nothing"])
        way = random.random()
        if way < 0.2:
            # An answer that nobody waits for: the next one makes up for it.
            edit.submit(report).close()
            continue
        model.check(edit.commit(report) if way < 0.6 else edit.submit(report).wait(), report)
        assert len(scene) == len(model.present())


@MARGINS
def test_scenes_are_as_a_model_says(daemon: Daemon, options: Any, margin: list[float]) -> None:
    with pairmask.Session("in-process") as session:
        for seed in range(5):
            run_scene(session.scene(most_boxes=100, **options), seed, 50, margin)
    with daemon.session() as session:
        run_scene(session.scene(**options), 9, 30, margin)


def test_near_pairs_and_what_is_sent(session: pairmask.Session) -> None:
    scene = session.scene(margins="near")

    def at(x: float) -> Any:
        return np.array([[x, 0, 0, x + 1, 1, 1]], np.float32)

    scene.edit().set(0, at(0), 0.5).set(1, at(1.2), [0.5]).commit()
    assert scene.edit().set(1, at(1.3), 0.5).commit().begun.tolist() == []
    assert scene.margin_stats == (2, 1, 3, 2) == pairmask.MarginStats(edits=2, requests=1, set=3, sent=2)
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
    oracle.check(scene.edit().commit().begun, oracle.pairs_of(boxes))
    assert len(scene.edit().commit().begun) == 0
    scene.resync()
    assert scene.edit().commit().is_resync


def test_indices_of_all_kinds(session: pairmask.Session) -> None:
    scene = session.scene()
    boxes = oracle.boxes_of(10, 3)
    mask = np.zeros(10, bool)
    mask[[8, 9]] = True
    edit = scene.edit().set(0, boxes[0]).set(range(1, 4), boxes[1:4]).set([4, 5], boxes[4:6].reshape(2, 2, 3))
    edit.set(np.array([6, 7]), boxes[6:8].astype(np.float64)).set(mask, boxes[8:].tolist()).set([], [])
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


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("beyond the 50 boxes", lambda edit: edit.set(50, UNIT)),
        ("give one for each", lambda edit: edit.set(range(3), [UNIT] * 2)),
        ("set twice", lambda edit: edit.set([1, 1], [UNIT] * 2)),
        ("has no box", lambda edit: edit.remove(9)),
        ("index 9 has no box", lambda edit: edit.tag(9, world=1)),
    ],
)
@MARGINS
def test_what_is_wrong_with_edits(
    session: pairmask.Session, text: str, wrong: Any, options: Any, margin: list[float]
) -> None:
    scene = session.scene(most_boxes=50, **options)
    boxes = oracle.boxes_of(3, 4)
    scene.edit().set(range(3), boxes, *margin).commit()
    for end in (pairmask.SceneEdit.commit, pairmask.SceneEdit.submit):
        with pytest.raises(pairmask.PairmaskError, match=text) as caught:
            end(wrong(scene.edit()))
        assert caught.value.kind == "Edit"
        with pytest.raises(ValueError, match="changes, moved, all, nothing"):
            end(scene.edit(), "some")  # type: ignore[arg-type]
    # The scene is what it was, and no edit of it is under way.
    oracle.check(scene.edit().submit("all").wait().pairs, oracle.pairs_of(boxes))


def test_an_edit_is_used_once(session: pairmask.Session) -> None:
    scene = session.scene()
    edit = scene.edit()
    edit.commit()
    for use in (edit.commit, lambda: edit.remove(0)):
        with pytest.raises(pairmask.PairmaskError, match="committed"):
            use()
    with pytest.raises(pairmask.PairmaskError, match="no margins"):
        scene.edit().set(0, UNIT, margin=0.5).commit()
    with pytest.raises(ValueError, match="exact, near"):
        session.scene(margins="some")  # type: ignore[arg-type]
    scene.close()
    assert kind_of(scene.edit().commit) == "Gone"


def test_rules_of_scenes(session: pairmask.Session) -> None:
    boxes = [UNIT] * 6
    scene = session.scene()
    table = FilterTable([Filter(1, 2), Filter(2, 3)])
    edit = scene.edit().set(range(6), boxes).filters(table).tag(range(6), world=[0, 0, 1, 1, -1, 1], filter=1)
    found = {(0, 1), (2, 3), (2, 5), (3, 5), *((a, 4) for a in range(4)), (4, 5)}
    oracle.check(edit.commit("all").pairs, found)
    answer = scene.edit().exclude([[0, 1], [2, 3]]).include([4, 0]).commit()
    assert answer.ended.tolist() == [[0, 1], [2, 3]]
    assert set(answer.ended_reasons.tolist()) == {EndReason.FILTERED}
    answer = scene.edit().exclude([[0, 1]], on=False).tag([2, 3], world=1, filter=0).commit()
    assert answer.begun.tolist() == [[0, 1]]
    assert len(scene.query(boxes[:1], world=1, filter=1)) == 4
    assert scene.query(boxes[:2], world=[0, 1], filter=1)[:, 1].tolist() == [0, 1, 4, 2, 3, 4, 5]
    assert scene.edit().tag(range(6), owner=3).tag(5, is_static=True, world=1).commit("all").pairs.tolist() == [[0, 4]]
    with pytest.raises(ValueError, match="2 worlds for 6 boxes: give one for each"):
        scene.query(boxes, world=[1, 2])


def test_queries(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(300, 5)
    scene = session.scene()
    scene.edit().set(range(300), boxes).commit("nothing")
    asked = oracle.boxes_of(40, 6, spread=2)
    assert scene.query(asked).tolist() == np.argwhere(oracle.overlapping(asked, boxes)).tolist()
    centres = pairmask.points((boxes[:, :3] + boxes[:, 3:]) / 2)
    assert {(a, a) for a in range(300)} <= set(map(tuple, scene.query(centres).tolist()))
    assert scene.query(asked[0]).shape[1] == 2 and scene.query(np.zeros((0, 6))).shape == (0, 2)
