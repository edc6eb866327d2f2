"""Nonsense of every kind over the wire: a typed exception each time, and a system that stays as it was.

The first test is a sample of `python -m bench.chaos.fuzz`, which calls every operation of the IDL."""

from __future__ import annotations

import contextlib
import copy
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from omniORB import CORBA

from robocorba.stubs import RoboCorba
from testkit.fuzzing.calls import call_many
from testkit.fuzzing.fuzzed_system import FuzzedSystem, fuzzed_system
from testkit.fuzzing.operations import interfaces, operations
from testkit.fuzzing.targets import OF_CLIENTS, OUT_OF_REACH, targets
from testkit.fuzzing.wire import OCTETS, UNREADABLE
from testkit.simulation import error_lines
from tests.system.elements import examples, ring

pytestmark = [pytest.mark.system, pytest.mark.full]

#: Inputs for each operation.
INPUTS = 3
#: Operations of which one call takes long.
SLOW = {"startRobot", "switchAdaptor", "check", "checkFloor", "buildTopologicalMap"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def fuzzed(folder: Path) -> Iterator[FuzzedSystem]:
    """The same processes serve at the end."""
    with fuzzed_system(folder) as system:
        yield system
        assert not system.ended()


def test_every_operation_answers_nonsense_with_an_exception_of_its_own(fuzzed: FuzzedSystem, folder: Path) -> None:
    everything = targets(fuzzed)
    called = {target.interface for target in everything}
    bases = {RoboCorba.Server}  # all that servers have of it is called by their own interfaces
    assert set(interfaces()) - called == {*OF_CLIENTS, *OUT_OF_REACH, *bases}
    faults = {}
    for target in everything:
        for operation in operations(target.interface):
            if operation.name not in target.omitted | SLOW:
                tally = call_many(target, operation, INPUTS, 1, fuzzed.seen)
                if tally.faults:
                    faults[f"{target.name}.{operation.name}"] = tally.faults
    assert not faults
    assert not error_lines(folder / "state") + error_lines(folder / "actual" / "state")


@pytest.mark.parametrize("content", UNREADABLE, ids=repr)
def test_texts_that_are_not_utf_8_are_refused(fuzzed: FuzzedSystem, content: bytes) -> None:
    version = fuzzed.editor._get_currentVersion()
    for target, operation in (
        (fuzzed.editor, "openSession"),
        (fuzzed.database, "removeMission"),
        (fuzzed.channel, "supply"),
        (fuzzed.agent, "loadProgram"),
        (fuzzed.supervisor, "endRobot"),
    ):
        interface = getattr(RoboCorba, type(target).__name__.removeprefix("_objref_"))
        _, returned, raised, *_ = getattr(interface, f"_d_{operation}")
        with pytest.raises((CORBA.DATA_CONVERSION, CORBA.BAD_PARAM, CORBA.MARSHAL)):
            target._obj.invoke(operation, ((OCTETS,), returned, raised), (content,))
    assert fuzzed.editor._get_currentVersion() == version
    assert not [each.name for each in fuzzed.channel.state().proxies if each.name and not each.name.isprintable()]


# ---- elements of a building with one member that can't be ----

#: What the server may grow by, MiB. Single messages have up to 10 MB.
GROWTH_MIB = 100
LONG = "x" * 1_000_000
numbers = st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, 1e7])
names = st.sampled_from(["", LONG, "ж" * 201, "two\nlines", "\x1b[2J", "\N{RIGHT-TO-LEFT OVERRIDE}", "\x7f"])
polygons = st.one_of(
    st.sampled_from(
        [
            ring((0, 0), (1, 1)),
            ring((0, 0), (1, 1), (1, 0), (0, 1)),  # crosses itself
            ring((0, 0), (1, 0), (2, 0)),  # no area
            ring(*[(0, 0)] * 5),
            ring((0, 0), (1, 0), (1e308, 1e308)),
            ring(*[(math.cos(i), math.sin(i)) for i in range(20_000)]),
        ]
    ),
    st.lists(st.builds(RoboCorba.XY, numbers, numbers), min_size=3, max_size=5),
)
#: Members that hold too much, or shapes without a size, by kind and member.
OTHERS: dict[str, dict[str, list[Any]]] = {
    "EDGE_ELEMENT": {"graphs": [["g"] * 100_000, [LONG]], "fromNode": ["nowhere"], "toNode": [LONG]},
    "NODE_ELEMENT": {"inElevator": ["E9", LONG]},
    "AREA_ELEMENT": {"subnet": [LONG, "a\nb"]},
    "ELEVATOR_ELEMENT": {
        "doors": [
            [],
            [RoboCorba.ElevatorDoor("L9", RoboCorba.FRONT, 1.0, 0.0)],
            [RoboCorba.ElevatorDoor("L1", RoboCorba.FRONT, 1.0, 0.0)] * 50_000,
            [RoboCorba.ElevatorDoor(LONG, RoboCorba.BACK, math.nan, math.inf)],
        ]
    },
    "OBJECT_ELEMENT": {
        "footprint": [
            *(RoboCorba.Shape(length=math.nan), RoboCorba.Shape(radius=0.0), RoboCorba.Shape(radius=-1e308)),
            *(RoboCorba.Shape(size=RoboCorba.XY(1e308, math.inf)), RoboCorba.Shape(points=[])),
        ]
    },
}


@st.composite
def wrong_elements(draw: st.DrawFn) -> tuple[str, Any]:
    """An element with one member that can't be, and its floor."""
    kind, example = draw(st.sampled_from(list(examples("bad").items())))
    value = copy.deepcopy(example.value)
    others = [(value._v, member, wrong) for member, values in OTHERS.get(kind, {}).items() for wrong in values]
    ways = [st.tuples(st.just(value._v), st.just("name"), names)] + ([st.sampled_from(others)] if others else [])
    for member, content in vars(value._v).items():
        for owner, name in (
            [(content, "x"), (content, "y")] if isinstance(content, RoboCorba.XY) else [(value._v, member)]
        ):
            if isinstance(getattr(owner, name), float):
                ways.append(st.tuples(st.just(owner), st.just(name), numbers))
        if member in ("outline", "polygon"):
            ways.append(st.tuples(st.just(value._v), st.just(member), polygons))
        elif member == "footprint":
            shapes = st.builds(lambda points: RoboCorba.Shape(points=points), polygons)
            ways.append(st.tuples(st.just(value._v), st.just(member), shapes))
    setattr(*draw(st.one_of(ways)))
    return example.floor, value


def test_a_wrong_element_is_refused(fuzzed: FuzzedSystem) -> None:
    editor, process = fuzzed.editor, psutil.Process(fuzzed.running.pid("map_editor"))
    before, began = (editor._get_currentVersion(), editor.exportMap()), process.memory_info().rss

    @given(wrong_elements())
    @settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
    def check(wrong: tuple[str, Any]) -> None:
        floor, value = wrong
        with pytest.raises(RoboCorba.InvalidElement) as refused:
            editor.create(floor, value)
        assert refused.value.id.kind == value._d
        assert refused.value.reason
        transaction = editor.begin()
        with pytest.raises(RoboCorba.InvalidElement):
            transaction.create(floor, value)
            transaction.commit()
        with contextlib.suppress(RoboCorba.TransactionClosed):
            transaction.rollBack()

    check()
    assert (editor._get_currentVersion(), editor.exportMap()) == before
    assert (process.memory_info().rss - began) / 2**20 < GROWTH_MIB
