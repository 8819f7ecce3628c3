"""Scenes and edits under way: what began, what ended and why, what there is, what queries find."""

import gc
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import UNIT, Daemon, kind_of
from pairmask import EndReason, Filter, FilterTable

# Options of a scene, and the margin that its boxes are set with beside.
MARGINS = pytest.mark.parametrize(
    "margins", [({}, []), ({"margins": "exact", "usual_margin": 0.1}, [0.2]), ({"margins": "near"}, [0.0])]
)

BACKENDS = pytest.mark.parametrize("backend", ["in-process", "auto", "daemon"])


def at(x: float) -> list[float]:
    return [x, 0, 0, x + 1, 1, 1]


@pytest.mark.parametrize("backend", ["in-process", "daemon"])
@MARGINS
def test_changes_have_reasons(daemon: Daemon, backend: str, margins: Any) -> None:
    options, margin = margins
    pairs = [[a, a + 1] for a in range(0, 10, 2)]
    with daemon.session(backend) as session, session.scene(most_boxes=100, **options) as scene:
        boxes = [at(10 * (index // 2) + index % 2 / 2) for index in range(10)]
        answer = scene.edit().set(range(10), boxes, *margin).commit()
        assert (answer.begun.tolist(), answer.pair_count, answer.is_resync) == (pairs, 5, False)
        edit = scene.edit().remove(1).set(3, at(99), *margin).set_enabled([4], False).make_static(range(6, 8))
        answer = edit.commit()
        assert answer.begun.tolist() == [] and answer.ended.tolist() == pairs[:4]
        reasons = [EndReason.REMOVED, EndReason.SEPARATED, EndReason.FILTERED, EndReason.FILTERED]
        assert answer.ended_reasons.tolist() == reasons and len(scene) == 9
        # An answer that nobody waits for: the next one makes up for it.
        scene.edit().set(1, at(0.5), *margin).submit().close()
        answer = scene.edit().set_enabled(4, True).make_static(6, False).submit().wait()
        assert answer.begun.tolist() == [pairs[0], pairs[2], pairs[3]] and answer.ended.shape == (0, 2)
        # Another box at the same index.
        answer = scene.edit().remove(8).set(8, boxes[8], *margin).commit()
        assert answer.begun.tolist() == answer.ended.tolist() == [pairs[4]]
        assert answer.ended_reasons.tolist() == [EndReason.REMOVED]
        answer = scene.edit().set(3, boxes[3], *margin).commit("nothing")
        assert (answer.pair_count, len(answer.pairs)) == (None, 0)
        assert scene.edit().commit("all").pairs.tolist() == pairs
        assert scene.edit().commit().begun.tolist() == []
        assert answer.served_by == backend


def test_near_pairs_and_what_is_sent(session: pairmask.Session) -> None:
    scene = session.scene(margins="near")
    scene.edit().set(0, at(0), 0.5).set(1, at(1.2), np.array([0.5])).commit()
    assert scene.edit().set(1, at(1.3), 0.5).commit().begun.tolist() == []
    assert scene.margin_stats == (2, 1, 3, 2) == pairmask.MarginStats(edits=2, requests=1, set=3, sent=2)
    inflated = scene.inflated(0)
    assert inflated is not None and inflated[0] <= -0.5
    # Queries are of the boxes as they were set.
    assert scene.query(at(1.05)).tolist() == [[0, 1]]
    assert scene.edit().set_filter(0, world=1).set_filter(1, world=2).commit().ended.tolist() == [[0, 1]]
    for wrong in (-1.0, float("nan"), [0.1, 0.2]):
        with pytest.raises((ValueError, pairmask.PairmaskError)):
            scene.edit().set(0, at(0), wrong).commit()


def test_moved_reports_the_pairs_of_what_moved(session: pairmask.Session) -> None:
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
        ("index 9 has no box", lambda edit: edit.set_filter(9, world=1)),
    ],
)
@MARGINS
def test_what_is_wrong_with_edits(session: pairmask.Session, text: str, wrong: Any, margins: Any) -> None:
    options, margin = margins
    scene = session.scene(most_boxes=50, **options)
    boxes = oracle.boxes_of(3, 4)
    scene.edit().set(range(3), boxes, *margin).commit()
    for end in (pairmask.SceneEdit.commit, pairmask.SceneEdit.submit):
        assert kind_of(lambda: end(wrong(scene.edit())), text) == "Edit"
        with pytest.raises(ValueError, match="changes, moved, all, nothing"):
            end(scene.edit(), "some")  # type: ignore[arg-type]
    # The scene is what it was, and no edit of it is under way.
    oracle.check(scene.edit().submit("all").wait().pairs, oracle.pairs_of(boxes))


def test_an_edit_is_used_once(session: pairmask.Session) -> None:
    scene = session.scene()
    edit = scene.edit()
    edit.commit()
    for use in (edit.commit, lambda: edit.remove(0)):
        assert kind_of(use, "committed") == "Closed"
    assert kind_of(scene.edit().set(0, UNIT, margin=0.5).commit, "no margins") == "Edit"
    with pytest.raises(ValueError, match="exact, near"):
        session.scene(margins="some")  # type: ignore[arg-type]
    scene.close()
    assert kind_of(scene.edit().commit) == "Closed"


def test_rules_of_scenes(session: pairmask.Session) -> None:
    boxes = [UNIT] * 6
    scene = session.scene()
    table = FilterTable([Filter(1, 2), Filter(2, 3)])
    edit = scene.edit().set(range(6), boxes).filter_table(table).set_filter(range(6), world=[0, 0, 1, 1, -1, 1], filter=1)
    found = {(0, 1), (2, 3), (2, 5), (3, 5), *((a, 4) for a in range(4)), (4, 5)}
    oracle.check(edit.commit("all").pairs, found)
    answer = scene.edit().exclude([[0, 1], [2, 3]]).include([4, 0]).commit()
    assert answer.ended.tolist() == [[0, 1], [2, 3]]
    assert set(answer.ended_reasons.tolist()) == {EndReason.FILTERED}
    answer = scene.edit().exclude([[0, 1]], on=False).set_filter([2, 3], world=1, filter=0).commit()
    assert answer.begun.tolist() == [[0, 1]]
    assert len(scene.query(boxes[:1], world=1, filter=1)) == 4
    assert scene.query(boxes[:2], world=[0, 1], filter=1)[:, 1].tolist() == [0, 1, 4, 2, 3, 4, 5]
    assert scene.edit().set_filter(range(6), owner=3).set_filter(5, is_static=True, world=1).commit("all").pairs.tolist() == [[0, 4]]
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


def test_origins_that_shift(session: pairmask.Session) -> None:
    boxes = np.floor(oracle.boxes_of(300, 5) * 4) / 4
    scene = session.scene()
    first = scene.edit().set(range(300), boxes).commit().begun
    assert len(first) > 10
    scene.shift_origin([-4096, 0.25, 8])
    changes = scene.edit().commit()
    assert len(changes.begun) == len(changes.ended) == 0 and not changes.is_resync
    box = scene.get(7)
    assert box is not None and box.tolist() == (boxes[7] + [-4096, 0.25, 8] * 2).tolist()
    oracle.check(scene.edit().commit("all").pairs, oracle.pairs_of(boxes))
    with pytest.raises(pairmask.PairmaskError, match="the scene cannot be moved"):
        scene.shift_origin([1e9, 0, 0])


def test_user_data(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(300, 5)
    scene = session.scene()
    given = np.arange(300, dtype=np.uint64) * 3 + 2**63
    begun = scene.edit().set(range(300), boxes).set_user_data(range(300), given).commit().begun
    assert len(begun) > 9
    assert (scene.user_data(begun) == given[begun]).all()
    scene.edit().set_user_data([7, 9], 5).remove(8).commit()
    assert scene.user_data(range(7, 11)).tolist() == [5, given[8], 5, given[10]]
    assert scene.user_data(8).shape == ()
    with pytest.raises(pairmask.PairmaskError, match="give one for each"):
        scene.edit().set_user_data([1, 2], [1, 2, 3]).commit()
    with pytest.raises((ValueError, TypeError)):
        scene.edit().set_user_data([1], [-1])


def test_snapshots(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(300, 5)
    scene = session.scene()
    scene.edit().set(range(300), boxes).commit()
    before = scene.snapshot()
    moved = oracle.boxes_of(300, 6)
    first = scene.edit().set(range(300), moved).commit()
    begun, ended = first.begun.tolist(), first.ended.tolist()
    assert begun and ended
    scene.restore(before)
    again = scene.edit().set(range(300), moved).commit()
    assert (again.begun.tolist(), again.ended.tolist()) == (begun, ended)
    scene.forget_snapshot(before)
    with pytest.raises(pairmask.PairmaskError, match="no snapshot"):
        scene.restore(before)


def test_saved_scenes(session: pairmask.Session, tmp_path: Path) -> None:
    boxes = oracle.boxes_of(300, 5)
    scene = session.scene()
    edit = scene.edit().set(range(300), boxes).set_enabled(7, False).filter_table(FilterTable([Filter(1, 1)]))
    pairs = edit.set_filter(range(9), owner=3).exclude([[20, 21]]).commit("all").pairs
    path = tmp_path / "scene"
    scene.save(path)
    loaded = session.load_scene(path, margins="exact", usual_margin=0.5)
    assert len(loaded) == 300
    assert loaded.edit().commit().begun.tolist() == pairs.tolist()
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(pairmask.PairmaskError, match="truncated"):
        session.load_scene(path)
    with pytest.raises(FileNotFoundError):
        session.load_scene(tmp_path / "no scene")


def test_casts(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(300, 5)
    scene = session.scene()
    scene.edit().set(range(300), boxes).commit("nothing")
    points = oracle.boxes_of(20, 6, spread=2)[:, :3].astype(np.float64)
    distances = oracle.distances(points, boxes)
    near = scene.nearest(points, closest=8)
    assert near.pairs[:, 0].tolist() == np.repeat(np.arange(20), 8).tolist()
    np.testing.assert_allclose(near.distances.reshape(20, 8), np.sort(distances)[:, :8], rtol=1e-6)
    np.testing.assert_allclose(near.distances, distances[tuple(near.pairs.T)], rtol=1e-6)
    within = scene.nearest(points, radius=0.0)
    assert sorted(map(tuple, within.pairs.tolist())) == list(map(tuple, np.argwhere(distances == 0).tolist()))

    directions = np.where(np.arange(20)[:, None] % 3 == np.arange(3), 1.0, 0.0)
    entries = oracle.entries(points, directions, boxes)
    hits = scene.cast(points, directions)
    assert sorted(map(tuple, hits.pairs.tolist())) == list(map(tuple, np.argwhere(np.isfinite(entries)).tolist()))
    np.testing.assert_allclose(hits.distances, entries[tuple(hits.pairs.T)], rtol=1e-6)
    first = scene.cast(points, directions, closest=1)
    are_hit = np.isfinite(entries).any(axis=1)
    assert first.pairs[:, 0].tolist() == np.flatnonzero(are_hit).tolist()
    assert scene.is_hit(points, directions).tolist() == are_hit.tolist()
    assert not scene.is_hit(points, [0, 0, 1], most=-1).any()
    assert scene.cast(points[0], directions[:3], most=[1, 2, 3], half_extents=[0, 0, 1]).pairs.shape[1] == 2
    assert scene.cast(np.zeros((0, 3)), [1, 0, 0]).distances.shape == (0,)
    with pytest.raises(ValueError, match="2 rows for 20 rays: give one for each, or one for all"):
        scene.cast(points, directions, most=[1, 2])


@BACKENDS
@MARGINS
def test_a_scene_is_left_alone_while_its_edit_is_under_way(daemon: Daemon, backend: str, margins: Any) -> None:
    options, margin = margins
    boxes = oracle.boxes_of(100, 1)
    with daemon.session(backend) as session, session.scene(**options) as scene:
        next_edit = scene.edit().set(range(50), boxes[50:], *margin)
        pending = scene.edit().set(range(100), boxes, *margin).submit("all")
        uses: list[Any] = [next_edit.commit, next_edit.submit, scene.resync, lambda: len(scene)]
        uses += [lambda: scene.get(0), lambda: scene.allocated_bytes]
        assert [kind_of(use) for use in uses] == ["UnderWay"] * len(uses)
        with pending:
            answer = pending.wait()
        oracle.check(answer.pairs, oracle.pairs_of(boxes))
        assert answer.served_by == ("in-process" if backend == "in-process" else "daemon")
        assert [kind_of(pending.wait) for _ in range(2)] == ["Closed"] * 2
        # The edit was not lost.
        oracle.check(next_edit.commit("all").pairs, oracle.pairs_of(np.vstack([boxes[50:], boxes[50:]])))
        assert kind_of(pending.wait) == kind_of(next_edit.submit) == "Closed"


@BACKENDS
@MARGINS
def test_answers_that_are_discarded_are_reported_again(daemon: Daemon, backend: str, margins: Any) -> None:
    options, margin = margins
    boxes = oracle.boxes_of(300, 2)
    with daemon.session(backend) as session, session.scene(**options) as scene:
        # More edits than the session has slots for frames.
        for step in range(12):
            pending = scene.edit().set(range(300), oracle.boxes_of(300, 2 + step % 2), *margin).submit()
            if step % 3 == 1:
                pending.close()
                pending.close()
                assert kind_of(pending.wait) == "Closed"
            elif step % 3 == 2:
                with pending:
                    pass
            del pending
        scene.edit().set(range(300), boxes, *margin).submit().close()
        assert len(scene) == 300
        answer = scene.edit().commit()
        oracle.check(answer.pairs if answer.is_resync else answer.begun, oracle.pairs_of(boxes))
        assert len(scene.edit().commit().begun) == 0
        oracle.check(session.cull(boxes), oracle.pairs_of(boxes))


@BACKENDS
@MARGINS
def test_a_scene_that_is_closed_ends_its_edit(daemon: Daemon, backend: str, margins: Any) -> None:
    options, margin = margins
    with daemon.session(backend) as session:
        with session.scene(**options) as scene:
            pending = scene.edit().set(range(3), oracle.boxes_of(3, 1), *margin).submit()
        assert kind_of(pending.wait) == kind_of(scene.edit().submit) == "Closed"
        pending.close()
        assert session.served_by() == ("in-process" if backend == "in-process" else "daemon")


def test_an_edit_keeps_its_scene_and_is_dropped_with_it(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(100, 3)
    scene = session.scene()
    pending = scene.edit().set(range(100), boxes).submit()
    del scene
    gc.collect()
    answer = pending.wait()
    del pending
    session.close()
    gc.collect()
    # Arrays outlive scenes, edits and sessions.
    oracle.check(answer.begun, oracle.pairs_of(boxes))


def test_a_daemon_that_dies_while_an_edit_is_under_way(daemon: Daemon) -> None:
    boxes = oracle.boxes_of(500, 5)
    with daemon.session("auto") as session, daemon.session("daemon", deadline=5) as forced:
        scene, other = session.scene(), forced.scene()
        for one in (scene, other):
            assert one.edit().set(range(500), boxes).submit().wait().served_by == "daemon" and one.daemon_bytes > 0
        boxes[3] = boxes[4]
        pending = [one.edit().set(3, boxes[4]).submit("all") for one in (scene, other)]
        daemon.kill()
        # The answer may have come before the daemon's end.
        oracle.check(pending[0].wait().pairs, oracle.pairs_of(boxes))
        try:
            oracle.check(pending[1].wait().pairs, oracle.pairs_of(boxes))
        except pairmask.PairmaskError as error:
            assert error.kind in ("DaemonDied", "NoDaemon")
        assert kind_of(pending[1].wait) == "Closed" and len(other) == 500
        answer = scene.edit().submit("all").wait()
        assert answer.served_by == "in-process"
        oracle.check(answer.pairs, oracle.pairs_of(boxes))


def test_edits_are_freed(session: pairmask.Session) -> None:
    scene = session.scene()
    scene.edit().set(range(100), oracle.boxes_of(100, 7)).commit()
    before = scene.allocated_bytes
    for _ in range(1000):
        scene.edit().set(range(100), oracle.boxes_of(100, 7)).submit()
    assert before > 0 and len(scene) == 100 and scene.allocated_bytes < before + (1 << 20)
