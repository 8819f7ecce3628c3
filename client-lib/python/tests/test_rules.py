"""Rules of frames: the pairs that seven rules let meet, written here once more from their text."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import UNIT, Daemon
from pairmask import Filter, FilterTable, Precision, Rules, filters

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
        self.include, self.exclude = random.integers(0, max(n, 1), (2, 3 * n if has_lists else 0, 2))

    def rules(self) -> Rules:
        tags: Any = {name: getattr(self, name) for name in ("worlds", "owners", "filters", "is_static")}
        return Rules(table=FilterTable(self.table), include=self.include, exclude=self.exclude, **tags)

    def meet(self) -> Any:
        """A matrix of which boxes may meet, rule by rule from the last to the first."""
        n = len(self.worlds)
        table = [*self.table, Filter()]
        kinds = np.minimum(self.filters, len(self.table))
        by_kind = np.array([[admits(a, b) for b in table] for a in table])
        meet = by_kind[np.ix_(kinds, kinds)]
        for a, b in self.exclude:
            meet[a, b] = meet[b, a] = False
        static = self.is_static | np.array([of.is_static for of in table])[kinds]
        meet &= ~(static[:, None] & static[None, :])
        meet &= (self.owners[:, None] != self.owners[None, :]) | (self.owners == 0)[:, None]
        for a, b in self.include:
            meet[a, b] = meet[b, a] = True
        same = self.worlds[:, None] == self.worlds[None, :]
        return meet.reshape(n, n) & (same | (self.worlds == -1)[:, None] | (self.worlds == -1)[None, :])

    def is_of_world(self, world: int, a: int, b: int) -> bool:
        """Whether a pair of these boxes is one of this world."""
        own = {self.worlds[a], self.worlds[b]}
        return world in own - {-1} or world == -1 and own == {-1}


@pytest.mark.parametrize("backend", ["in-process", "daemon"])
@pytest.mark.parametrize("kind", KINDS)
def test_rules_of_frames(daemon: Daemon, backend: str, kind: tuple[list[int], int, bool]) -> None:
    with daemon.session(backend) as session:
        for n in (0, 1, 2, 70, 345):
            boxes = oracle.boxes_of(n, n, spread=0.5)
            ruled = Ruled(n, kind, 100 * len(kind[0]) + n)
            rules, meet = ruled.rules(), ruled.meet()
            expected = oracle.pairs_of(boxes, meet)
            assert len(rules) == n
            assert all(rules.meet(a, b) == meet[a, b] for a in range(min(n, 20)) for b in range(min(n, 20)) if a != b)
            for _ in range(3):
                oracle.check(session.cull(boxes, rules), expected, (kind, n))
            for frame in (session.frame(n), session.narrow_frame(n, Precision.exact())):
                frame.write(boxes)
                with frame.submit(filters=rules).wait() as mask:
                    oracle.check(mask.pairs(), expected, (kind, n))
                    # Each world's pairs stand together, where the mask says that it has them so.
                    for world in mask.worlds():
                        pairs = mask.pairs_of_world(world)
                        oracle.check(pairs, {pair for pair in expected if ruled.is_of_world(world, *pair)}, world)
                    assert mask.pairs_of_world(123_456) is None
        assert session.served_by() == backend


def test_four_thousand_worlds_in_one_frame(session: pairmask.Session) -> None:
    worlds, boxes_each = 4096, 8
    one = oracle.boxes_of(boxes_each, 3)
    rules = Rules(worlds=np.repeat(np.arange(worlds), boxes_each))
    expected = np.array(sorted(oracle.pairs_of(one)))
    found = oracle.as_set(session.cull(np.tile(one, (worlds, 1)), rules))
    assert found == {tuple(pair) for world in range(worlds) for pair in (expected + world * boxes_each).tolist()}


def test_numbers_for_all_are_for_frames_of_any_number(session: pairmask.Session) -> None:
    table = FilterTable([Filter(1, 1), Filter(1, 2), Filter(2, 2, is_static=True)])
    cases: list[tuple[dict[str, Any], bool]] = [
        ({"worlds": 1}, True),
        ({"worlds": -1, "owners": 0, "is_static": False}, True),
        ({"owners": np.uint32(7)}, False),
        ({"owners": np.array(7)}, False),
        ({"is_static": True}, False),
        ({"table": table}, True),
        ({"table": table, "filters": 0}, True),
        ({"table": table, "filters": 1}, False),
        ({"table": table, "filters": 2}, False),
        ({"table": table, "filters": 3}, True),
    ]
    for given, do_meet in cases:
        rules = Rules(include=[0, 1], exclude=[[1, 2]], **given)
        for n in (3, 5):
            every = {(a, b) for b in range(n) for a in range(b)}
            expected = (every - {(1, 2)} if do_meet else set()) | {(0, 1)}
            oracle.check(session.cull([UNIT] * n, rules), expected, given)
            assert {pair for pair in every if rules.meet(*pair)} == expected
            # The same with a number for each.
            each: Any = {name: of if name == "table" else [of] * n for name, of in given.items()}
            oracle.check(session.cull([UNIT] * n, Rules(include=[0, 1], exclude=[[1, 2]], **each)), expected, each)
    assert len(Rules()) == len(Rules(owners=7)) == 0 and len(Rules(owners=7, worlds=[1, 1])) == 2


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"worlds": [0, 1], "owners": [0]}, ValueError),
        ({"worlds": [[0, 1]]}, ValueError),
        ({"owners": [-1]}, ValueError),
        ({"filters": [2**16]}, ValueError),
        ({"worlds": [2**31]}, ValueError),
        ({"include": [[0, 1, 2]]}, ValueError),
        ({"exclude": [[-1, 0]]}, ValueError),
        ({"worlds": [0.5]}, TypeError),
        ({"owners": ["a"]}, TypeError),
        ({"table": [Filter()]}, TypeError),
        ({"include": [[0.0, 1.0]]}, TypeError),
    ],
)
def test_what_is_wrong_with_rules(given: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        Rules(**given)


@pytest.mark.parametrize(
    ("rules", "text"),
    [
        (Rules(worlds=[1, 2, 3]), "3 tags for 4 boxes"),
        (Rules(worlds=[1, 2, 3, 4, 5], owners=3), "5 tags for 4 boxes"),
        (Rules(exclude=[[0, 4]]), "box 4 of a frame of 4"),
    ],
)
def test_rules_of_another_frame(session: pairmask.Session, rules: Rules, text: str) -> None:
    boxes = oracle.boxes_of(4, 7)
    frame = session.frame(4)
    frame.write(boxes)
    for use in (lambda: session.cull(boxes, rules), lambda: frame.submit(filters=rules)):
        with pytest.raises(ValueError, match=text):
            use()


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
    with pytest.raises(ValueError, match="65,536"):
        FilterTable([Filter()] * 65_537)
    with pytest.raises(OverflowError):
        Filter(-1)
    assert Filter(1, 2) == Filter(1, 2) != Filter(1, 3)
