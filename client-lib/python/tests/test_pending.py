"""Edits under way: submitted, waited for, given up, and scenes that they borrow."""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import Daemon, kind_of

BACKENDS = pytest.mark.parametrize("backend", ["in-process", "auto", "daemon"])


def scenes_of(session: pairmask.Session) -> list[Any]:
    """A scene without margins and two with some, and the arguments that its boxes have beside."""
    return [(session.scene(), []), (session.scene(margins="exact"), [0.1]), (session.scene(margins="near"), [0.0])]


@BACKENDS
def test_a_scene_is_left_alone_while_its_edit_is_under_way(daemon: Daemon, backend: str) -> None:
    with daemon.session(backend) as session:
        boxes = oracle.boxes_of(100, 1)
        for scene, margin in scenes_of(session):
            next_edit = scene.edit().set(range(50), boxes[50:], *margin)
            pending = scene.edit().set(range(100), boxes, *margin).submit("all")
            uses: list[Callable[[], object]] = [
                next_edit.commit,
                next_edit.submit,
                scene.resync,
                lambda: len(scene),
                lambda: scene.get(0),
                lambda: scene.allocated_bytes,
            ]
            assert [kind_of(use) for use in uses] == ["UnderWay"] * len(uses)
            with pending:
                answer = pending.wait()
            oracle.check(answer.pairs, oracle.pairs_of(boxes))
            assert answer.served_by == ("in-process" if backend == "in-process" else "daemon")
            assert [kind_of(pending.wait) for _ in range(2)] == ["Gone"] * 2
            # The edit was not lost.
            both = np.vstack([boxes[50:], boxes[50:]])
            oracle.check(next_edit.commit("all").pairs, oracle.pairs_of(both))
            assert kind_of(pending.wait) == kind_of(next_edit.submit) == "Gone"


@BACKENDS
@pytest.mark.parametrize("way", ["dropped", "closed", "left"])
def test_an_answer_that_is_given_up_is_told_again(daemon: Daemon, backend: str, way: str) -> None:
    with daemon.session(backend) as session:
        boxes = oracle.boxes_of(300, 2)
        for scene, margin in scenes_of(session):
            # More edits than the session has places for frames.
            for step in range(8):
                edit = scene.edit().set(range(300), oracle.boxes_of(300, 2 + step % 2), *margin)
                pending = edit.submit()
                if way == "closed":
                    pending.close()
                    pending.close()
                    assert kind_of(pending.wait) == "Gone"
                elif way == "left":
                    with pending:
                        pass
                del pending
            scene.edit().set(range(300), boxes, *margin).submit().close()
            assert len(scene) == 300
            answer = scene.edit().commit()
            oracle.check(answer.pairs if answer.is_resync else answer.begun, oracle.pairs_of(boxes))
            assert len(scene.edit().commit().begun) == 0
        oracle.check(session.cull(boxes), oracle.pairs_of(boxes))


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


@BACKENDS
def test_a_scene_that_is_closed_ends_its_edit(daemon: Daemon, backend: str) -> None:
    with daemon.session(backend) as session:
        for scene, margin in scenes_of(session):
            with scene:
                pending = scene.edit().set(range(3), oracle.boxes_of(3, 1), *margin).submit()
            assert kind_of(pending.wait) == kind_of(scene.edit().submit) == "Gone"
            pending.close()
            del pending
        assert session.served_by() == ("in-process" if backend == "in-process" else "daemon")


def test_a_daemon_that_dies_while_an_edit_is_under_way(daemon: Daemon) -> None:
    boxes = oracle.boxes_of(500, 5)
    with daemon.session("auto") as session, daemon.session("daemon", deadline=5) as insists:
        scene, other = session.scene(), insists.scene()
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
        assert kind_of(pending[1].wait) == "Gone" and len(other) == 500
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
