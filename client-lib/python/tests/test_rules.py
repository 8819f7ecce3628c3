"""Rules of frames: the pairs that seven rules let meet, written here once more from their text."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import Daemon
from pairmask import Filter, FilterTable, Rules, filters

# Worlds, filters and lists, alone and together, as the Rust suite has them.
KINDS: list[tuple[list[int], int, bool]] = [
    ([0], 70, False),
    ([7, -1], 12, True),
    ([0, 1, 2], 0, False),
    ([3, -1, 9, 9, 9, -4], 0, False),
    ([3, 3, -1, 9, -(2**31), 2**31 - 1], 9, True),
    ([-1], 0, True),
    ([5], 3, False),
]


def admits(a: Filter, b: Filter) -> bool:
    if a.group == b.group != 0:
        return a.group > 0
    one, other = a.category & b.mask != 0, b.category & a.mask != 0
    return one or other if a.either and b.either else one and other


class Ruled:
    """Random rules of `n` boxes, and which of the boxes may meet."""

    def __init__(self, n: int, kind: tuple[list[int], int, bool], seed: int) -> None:
        random = np.random.default_rng(seed)
        worlds, filter_count, has_lists = kind
        self.worlds = random.choice(worlds, n)
        self.owners = random.integers(0, n // 2 + 2, n) * random.integers(0, 2, n)
        self.filters = random.integers(0, filter_count + 1, n)
        self.is_static = random.random(n) < 0.2
        self.table = [
            Filter(
                int(random.integers(1, 16)),
                int(random.integers(0, 16)),
                group=int(random.integers(-2, 3)) * int(random.random() < 0.3),
                is_static=bool(random.random() < 0.2),
                either=bool(random.random() < 0.3),
            )
            for _ in range(filter_count)
        ]
        count = 3 * n if has_lists else 0
        lists: list[Any] = [random.integers(0, n, (count, 2)) for _ in range(2)] if n else [np.zeros((0, 2), int)] * 2
        self.include: Any = lists[0]
        self.exclude: Any = lists[1]

    def rules(self) -> Rules:
        return Rules(
            worlds=self.worlds,
            owners=self.owners,
            filters=self.filters,
            is_static=self.is_static,
            table=FilterTable(self.table),
            include=self.include,
            exclude=self.exclude,
        )

    def meet(self) -> Any:
        """A matrix of which boxes may meet, rule by rule from the last to the first."""
        n = len(self.worlds)
        table = [*self.table, Filter()]
        kinds = np.minimum(self.filters, len(self.table))
        by_kind = np.array([[admits(a, b) for b in table] for a in table])
        meet = by_kind[np.ix_(kinds, kinds)]
        listed = np.zeros((n, n), bool)
        for a, b in self.exclude:
            listed[a, b] = listed[b, a] = True
        meet &= ~listed
        static = self.is_static | np.array([of.is_static for of in table])[kinds]
        meet &= ~(static[:, None] & static[None, :])
        meet &= (self.owners[:, None] != self.owners[None, :]) | (self.owners == 0)[:, None]
        for a, b in self.include:
            meet[a, b] = meet[b, a] = True
        same = self.worlds[:, None] == self.worlds[None, :]
        return meet & (same | (self.worlds == -1)[:, None] | (self.worlds == -1)[None, :])


def check_kinds(session: pairmask.Session, sizes: tuple[int, ...]) -> None:
    for at, kind in enumerate(KINDS):
        for n in sizes:
            boxes = oracle.boxes_of(n, n, spread=0.5)
            ruled = Ruled(n, kind, 100 * at + n)
            rules, meet = ruled.rules(), ruled.meet()
            expected = oracle.pairs_of(boxes, meet)
            assert len(rules) == n
            assert all(rules.meet(a, b) == meet[a, b] for a in range(min(n, 20)) for b in range(min(n, 20)) if a != b)
            for _ in range(3):
                oracle.check(session.cull(boxes, rules), expected, (kind, n))
            frame = session.frame(n)
            frame.boxes[:] = boxes
            with frame.submit(filters=rules).wait() as mask:
                oracle.check(mask.pairs(), expected, (kind, n))
                check_worlds(mask, ruled, expected)


def check_worlds(mask: pairmask.PairMask, ruled: Ruled, expected: oracle.Pairs) -> None:
    """Each world's pairs stand together, where the mask says that it has them so."""
    for world in mask.worlds():
        pairs = mask.pairs_of_world(world)
        assert pairs is not None
        own = {
            (a, b) for a, b in expected if world in {w for w in (ruled.worlds[a], ruled.worlds[b]) if w != -1} or
            (world == -1 and ruled.worlds[a] == ruled.worlds[b] == -1)
        }
        oracle.check(pairs, own, world)
    assert mask.pairs_of_world(123_456) is None


def test_rules_in_process(session: pairmask.Session) -> None:
    check_kinds(session, (0, 1, 2, 70, 345))


def test_rules_by_a_daemon(daemon: Daemon) -> None:
    with daemon.session("daemon") as session:
        check_kinds(session, (0, 2, 345))
        assert session.served_by() == "daemon"


def test_narrow_frames_have_rules(session: pairmask.Session) -> None:
    boxes = oracle.boxes_of(200, 1)
    ruled = Ruled(200, KINDS[1], 1)
    frame = session.narrow_frame(200, pairmask.Precision.exact())
    frame.write(boxes)
    pairs = frame.submit(filters=ruled.rules()).wait().pairs()
    oracle.check(pairs, oracle.pairs_of(boxes, ruled.meet()))


def test_four_thousand_worlds_in_one_frame(session: pairmask.Session) -> None:
    worlds, boxes_each = 4096, 8
    one = oracle.boxes_of(boxes_each, 3)
    boxes = np.tile(one, (worlds, 1))
    rules = Rules(worlds=np.repeat(np.arange(worlds), boxes_each))
    expected = sorted(oracle.pairs_of(one))
    pairs = session.cull(boxes, rules)
    assert len(pairs) == worlds * len(expected)
    by_world = pairs.reshape(worlds, len(expected), 2) - (np.arange(worlds) * boxes_each)[:, None, None]
    assert (np.sort(by_world.view("i8,i8"), axis=1).view(np.int64).reshape(by_world.shape) == expected).all()


def test_what_is_wrong_with_rules() -> None:
    for wrong in (
        {"worlds": 3},
        {"worlds": [0, 1], "owners": [0]},
        {"owners": [-1]},
        {"filters": [2**16]},
        {"worlds": [2**31]},
        {"include": [[0, 1, 2]]},
        {"exclude": [[-1, 0]]},
    ):
        with pytest.raises(ValueError):
            Rules(**wrong)
    for typed in ({"worlds": [0.5]}, {"owners": ["a"]}, {"table": [Filter()]}, {"include": [[0.0, 1.0]]}):
        with pytest.raises(TypeError):
            Rules(**typed)
    with pytest.raises(ValueError, match="65,536"):
        FilterTable([Filter()] * 65_537)
    with pytest.raises(OverflowError):
        Filter(-1)
    assert len(Rules()) == 0 and len(Rules(owners=7, worlds=[1, 1])) == 2


def test_filters_of_other_engines() -> None:
    assert filters.from_rapier(1, 2).admits(filters.from_rapier(2, 1))
    assert not filters.from_avian(1, 2).admits(filters.from_avian(1, 2))
    assert filters.from_box2d(1, 2, -3).group == -3 and filters.from_box2d(1, 1, is_dynamic=False).is_static
    assert filters.from_bullet(1, -1).admits(filters.from_bullet(-1, 1))
    assert filters.from_mujoco(1, 0).admits(filters.from_mujoco(0, 1))
    assert not filters.from_newton(-1).admits(filters.from_newton(-1))
    assert filters.from_jolt_mask(1, 2) == filters.from_physx_words(1, 2) == filters.from_avian(1, 2)
    assert filters.owner_of(0) == 1 and filters.owner_of(2**32 - 1) == 0
    table = FilterTable([Filter(1, 2), Filter(2, 3)])
    assert table.meet(0, 1) and not table.meet(0, 0) and table[1].mask == 3 and len(table) == 2
    with pytest.raises(IndexError):
        table[2]
    assert Filter(1, 2) == Filter(1, 2) != Filter(1, 3)
