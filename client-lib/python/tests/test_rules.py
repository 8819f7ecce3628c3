"""Rules of frames: each part of them reaches the library, alone and with others."""

from typing import Any

import numpy as np
import oracle
import pairmask
import pytest
from conftest import UNIT, Daemon
from pairmask import Filter, FilterTable, Precision, Rules, filters

N = 6
ALL = {(a, b) for b in range(N) for a in range(b)}
TABLE = FilterTable([Filter(1, 2), Filter(2, 3), Filter(4, 0, group=7), Filter(4, 0, group=7, is_static=True)])
# Parts of rules, and the pairs that each lets meet. Filter 9 is beyond the table: it meets all.
PARTS: dict[str, tuple[Any, oracle.Pairs]] = {
    "filters": ([0, 1, 2, 3, 9, 0], {(0, 1), (1, 5), (2, 3), (0, 4), (1, 4), (4, 5)}),
    "exclude": ([[4, 1], [2, 3]], ALL - {(1, 4), (2, 3)}),
    "is_static": (np.array([True, False, True, False, False, True]), ALL - {(0, 2), (0, 5), (2, 5)}),
    "owners": ([1, 1, 2, 0, 0, 2], ALL - {(0, 1), (2, 5)}),
    "include": ([[1, 2], [3, 2], [2, 5]], {(1, 2), (2, 3), (2, 5)}),
    "worlds": (np.array([0, 0, 1, 1, -1, 1]), {*((a, 4) for a in range(4)), (0, 1), (2, 3), (2, 5), (3, 5), (4, 5)}),
}


@pytest.mark.parametrize("backend", ["in-process", "daemon"])
@pytest.mark.parametrize("names", [*([name] for name in PARTS), ["owners", "include"], list(PARTS)])
def test_rules_of_frames(daemon: Daemon, backend: str, names: list[str]) -> None:
    given: Any = {name: PARTS[name][0] for name in names}
    rules = Rules(table=TABLE if "filters" in names else None, **given)
    expected = ALL
    for name in names:
        # An include list has the last word, but for worlds.
        expected = expected | PARTS[name][1] if name == "include" else expected & PARTS[name][1]
    boxes = [UNIT] * N
    assert {pair for pair in ALL if rules.meet(*pair)} == expected
    with daemon.session(backend) as session:
        for _ in range(3):
            oracle.check(session.cull(boxes, rules), expected)
        for frame in (session.frame(N), session.narrow_frame(N, Precision.exact())):
            frame.write(boxes)
            with frame.submit(filters=rules).wait() as mask:
                oracle.check(mask.pairs(), expected)
        assert session.served_by() == backend


def test_four_thousand_worlds_in_one_frame(session: pairmask.Session) -> None:
    worlds, boxes_each = 4096, 8
    one = oracle.boxes_of(boxes_each, 3)
    rules = Rules(worlds=np.repeat(np.arange(worlds), boxes_each))
    expected = np.array(sorted(oracle.pairs_of(one)))
    frame = session.frame(worlds * boxes_each)
    frame.write(np.tile(one, (worlds, 1)))
    mask = frame.submit(filters=rules).wait()
    found = oracle.as_set(mask.pairs())
    assert found == {tuple(pair) for world in range(worlds) for pair in (expected + world * boxes_each).tolist()}
    # Each world's pairs stand together, where the mask says that it has them so.
    for world in mask.worlds():
        pairs = mask.pairs_of_world(world)
        assert pairs is not None and sorted(pairs.tolist()) == (expected + world * boxes_each).tolist()
    assert mask.pairs_of_world(123_456) is None and len(rules) == worlds * boxes_each


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
        (Rules(worlds=[1, 2, 3]), "filter data of 3 boxes for 4 boxes"),
        (Rules(worlds=[1, 2, 3, 4, 5], owners=3), "filter data of 5 boxes for 4 boxes"),
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


def test_filters_and_those_of_other_engines() -> None:
    assert not Filter(1, 2).admits(Filter(2, 4)) and Filter(1, 2, either=True).admits(Filter(2, 4, either=True))
    assert not Filter(group=-3).admits(Filter(group=-3)) and repr(Filter(5, 6)) != repr(Filter(6, 5))
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
