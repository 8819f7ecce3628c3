"""Sessions with a margin: the exact pairs whatever is kept, and near pairs that hold them."""

from __future__ import annotations

import gc
from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import Daemon

BACKENDS = pytest.mark.parametrize("backend", ["in-process", "auto", "daemon"])
MARGIN = 0.25


def gaps_of(boxes: Any, pairs: Any) -> Any:
    """How far apart the boxes of each pair are, on the axis on which they are farthest."""
    a, b = (boxes[pairs[:, at]].astype(np.float64) for at in (0, 1))
    return np.maximum(a[:, :3] - b[:, 3:], b[:, :3] - a[:, 3:]).max(axis=1, initial=0)


@BACKENDS
def test_boxes_that_move_little_are_asked_about_seldom(daemon: Daemon, backend: str) -> None:
    random = np.random.default_rng(1)
    boxes = oracle.boxes_of(800, 1)
    served_by = "in-process" if backend == "in-process" else "daemon"
    with pairmask.Margined(daemon.session(backend), MARGIN) as margined:
        assert margined.served_by() == served_by and margined.margin == MARGIN
        for step in range(40):
            boxes += np.tile(random.uniform(-0.01, 0.01, (800, 3)), 2).astype(np.float32)
            expected = oracle.pairs_of(boxes)
            oracle.check(margined.cull(boxes), expected, step)
            near = margined.cull(boxes, "near")
            assert expected <= oracle.as_set(near)
            # Both boxes may have moved by a margin since, and were inflated by one.
            assert gaps_of(boxes, near).max() <= 4 * MARGIN + 1e-4
        stats = margined.stats
        assert stats.requests + stats.skipped == 80 and 1 <= stats.requests <= 8
        margined.forget()
        oracle.check(margined.cull(boxes), expected)
        assert margined.stats.requests == stats.requests + 1


def test_what_leaves_its_margin_is_asked_about(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(300, 2)
    margined = pairmask.Margined(session, MARGIN)
    changes: list[Any] = [
        lambda b: b,
        lambda b: b + 0.2,
        lambda b: b + 0.2,
        lambda b: b[:299],
        lambda b: np.where(np.arange(299)[:, None] == 7, np.nan, b),
        lambda b: oracle.boxes_of(299, 3),
        lambda b: b[:0],
        lambda b: b,
    ]
    requests = []
    for change in changes:
        boxes = change(boxes).astype(np.float32)
        oracle.check(margined.cull(boxes), oracle.pairs_of(boxes))
        requests.append(margined.stats.requests)
    assert requests == [1, 1, 2, 3, 3, 4, 5, 5]


def test_margined_boxes_in_a_narrow_form(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(500, 4)
    for precision in (pairmask.Precision.f16(), pairmask.Precision.q16_around(boxes)):
        with pairmask.Margined(pairmask.Session("in-process"), 0.5, precision=precision) as margined:
            oracle.check(margined.cull(boxes), oracle.pairs_of(boxes), precision)
            assert len(margined.cull(boxes, "near")) > len(margined.cull(boxes))


def test_what_is_wrong_with_margined_sessions(session: pairmask.Session) -> None:
    for margin in (-1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError):
            pairmask.Margined(session, margin)
    boxes = oracle.boxes_of(10, 5)
    # The session was not given away by that.
    oracle.check(session.cull(boxes), oracle.pairs_of(boxes))
    margined = pairmask.Margined(session, 0.5)
    for use in (lambda: session.cull(boxes), lambda: pairmask.Margined(session, 0.5)):
        with pytest.raises(pairmask.PairmaskError, match="given to a Margined"):
            use()
    with pytest.raises(ValueError, match="exact, near"):
        margined.cull(boxes, "all")  # type: ignore[arg-type]
    with pytest.raises(ValueError):
        margined.cull(boxes[:, :5])
    pairs = margined.cull(boxes)
    margined.close()
    margined.close()
    with pytest.raises(pairmask.PairmaskError, match="closed") as caught:
        margined.cull(boxes)
    assert caught.value.kind == "Gone"
    del margined
    gc.collect()
    oracle.check(pairs, oracle.pairs_of(boxes))
    with pairmask.Margined(pairmask.Session("in-process", engine="gpu-grid"), 0.5) as insists:
        with pytest.raises(pairmask.FrameError) as refused:
            insists.cull(boxes)
        assert refused.value.kind == "Cull" and insists.stats.requests == 0


def test_a_daemon_that_dies_costs_no_answer(daemon: Daemon) -> None:
    boxes = oracle.boxes_of(400, 6)
    margined = pairmask.Margined(daemon.session("auto"), MARGIN)
    insists = pairmask.Margined(daemon.session("daemon"), MARGIN)
    for one in (margined, insists):
        oracle.check(one.cull(boxes), oracle.pairs_of(boxes))
    daemon.kill()
    # The mask that is kept lies in memory that stays.
    for one in (margined, insists):
        moved = boxes + np.float32(0.1)
        oracle.check(one.cull(moved), oracle.pairs_of(moved))
        assert one.stats.requests == 1
    far = oracle.boxes_of(400, 7)
    oracle.check(margined.cull(far), oracle.pairs_of(far))
    with pytest.raises(pairmask.PairmaskError) as caught:
        insists.cull(far)
    assert isinstance(caught.value, (pairmask.FrameError, pairmask.WaitError))
    # The last answer is kept.
    oracle.check(insists.cull(boxes), oracle.pairs_of(boxes))
