"""Fleet files: what they say, and the one line for everything that is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robocorba.errors.maps import MapFileError
from robocorba.processes import RobotOrder
from robocorba.supervision.fleet_file import InvalidFleet, group_of, read_fleet
from robocorba.supervision.robots import MAX_ROBOTS

SAMPLES = Path(str(files("robocorba") / "samples"))
FLOORS, CHANNELS = ["L1", "L2"], ["main", "lab"]


def orders(folder: Path, content: Any) -> list[RobotOrder]:
    file = folder / "fleet.yaml"
    file.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return read_fleet(file)(FLOORS, CHANNELS)


def test_the_sample() -> None:
    found = read_fleet(SAMPLES / "fleet.yaml")(["L1", "L2"], ["main"])
    assert [order.name for order in found] == ["Courier", "Guide", *(f"Night{number}" for number in range(1, 5))]
    assert found[0].at == (17.0, 7.5, 1.57) and found[0].program == SAMPLES / "both-floors.json"
    assert {order.channel for order in found} == {"main"}
    assert [order.floor for order in found] == ["L1"] * 2 + ["L2"] * 4


def test_a_robot_has_defaults_unless_it_says_otherwise(tmp_path: Path) -> None:
    content = {
        "defaults": {"floor": "L2", "adaptor": "corba", "arguments": ["--x", "1"]},
        "robots": [{"name": "A"}, {"prefix": "B", "count": 2, "adaptor": "simulated", "arguments": []}],
    }
    first, *others = orders(tmp_path, content)
    assert first == RobotOrder("A", "corba", ("--x", "1"), "L2")
    assert others == [RobotOrder("B1", floor="L2"), RobotOrder("B2", floor="L2")]


def test_a_placed_robot_without_a_floor_is_on_the_first_one(tmp_path: Path) -> None:
    (order,) = orders(tmp_path, {"robots": [{"name": "A", "at": [1, 2]}]})
    assert (order.floor, order.at) == ("L1", (1.0, 2.0, 0.0))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("robots: [{name: A, flor: L1}]", r":1: robots\[0\]\.flor: robot 'A': there is no such key"),
        ("robots: [{name: A},\n {name: A}]", r":2: robots\[1\]\.name: robot 'A': A is the name of another robot too"),
        ("robots: [{prefix: A, count: 2}, {name: A2}]", r"robots\[1\]\.name: robot 'A2': A2 is the name of another"),
        ("robots: [{name: A, name: B}]", r"robots\[0\]\.name: given twice"),
        ("robots: [{name: A b}]", r"robots\[0\]\.name: robot 'A b': .* letters"),
        ("robots: [{name: A, floor: L9}]", r"robots\[0\]\.floor: robot 'A': there is no floor 'L9'; there are L1, L2"),
        ("robots: [{name: A, channel: nix}]", r"robots\[0\]\.channel: robot 'A': there is no channel 'nix'"),
        ("robots: [{name: A, floor: null}]", r"robots\[0\]\.floor: robot 'A': Expected `str`, got `null`"),
        ("robots: [{name: A, at: [1]}]", r"robots\[0\]\.at: robot 'A': Expected `array` of length >= 2"),
        ("robots: [{name: A, at: [1, .inf]}]", r"robots\[0\]\.at: robot 'A': inf is not a number"),
        ("robots: [{name: A, program: nix.json}]", r"robots\[0\]\.program: robot 'A': .*nix.json: No such file"),
        ("robots: [{name: A, program: fleet.yaml}]", r"robots\[0\]\.program: robot 'A': .*fleet.yaml: .*not JSON"),
        ("defaults: {adaptor: nix}\nrobots: [{name: A}]", r":1: defaults\.adaptor: robot 'A': 'nix' is not installed"),
        ("robots: [{name: A, count: 2}]", r"robots\[0\]\.count: robot 'A': a robot with a name is no group"),
        ("robots: [{prefix: A, count: 2, at: [1, 2]}]", r"robots\[0\]\.at: robots 'A': several robots can't start"),
        ("robots: [{prefix: A, count: 201}]", r"robots\[0\]\.count: robot 'A': Expected `int` <= 200"),
        ("robots: [{prefix: A}]", r"robots\[0\]: robots 'A': needs a name, or prefix and count"),
        ("robots: [{}]", r"robots\[0\]: a robot: needs a name, or prefix and count"),
        ("robots: [3]", r"robots\[0\]: Expected `object`, got `int`"),
        ("robots: []", r"robots: Expected `array` of length >= 1"),
        ("[]", "Expected `object`"),
        ("robots: [{prefix: A, count: 200}, {name: X}]", r"robots\[1\]: robot 'X': more than 200 robots"),
        ('robots: [{name: A, arguments: ["\\0"]}]', r"robots\[0\]\.arguments: robot 'A': contains a null character"),
        ("#" * 300_000, "larger than 256 KiB"),
    ],
)
def test_what_is_wrong_is_one_line_with_the_key_and_the_robot(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(MapFileError, match=message) as wrong:
        orders(tmp_path, content)
    assert "\n" not in str(wrong.value)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="No such file"):
        read_fleet(tmp_path / "nix.yaml")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"prefix": "a b", "count": 3}, "name: robots 'a b': 'a b1' is not"),
        ({"prefix": "R", "count": MAX_ROBOTS + 1}, "count: Expected `int` <= 200"),
        ({"prefix": "R", "count": 2, "program": "nix.json"}, "program: robots 'R': .*No such file"),
    ],
)
def test_a_group_of_the_command_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidFleet, match=message):
        group_of(options)
    assert len(group_of({"prefix": "R", "count": MAX_ROBOTS})(FLOORS, CHANNELS)) == MAX_ROBOTS


anything = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 300) | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
names = st.sampled_from(["A", "B", "A1", "A2", "x y", ""]) | st.text(max_size=70)
entries = st.fixed_dictionaries(
    {},
    optional={
        "name": names | anything,
        "prefix": names | anything,
        "count": st.integers(-1, 250) | anything,
        "at": st.lists(st.floats() | st.integers(), max_size=4) | anything,
        "floor": st.sampled_from(["L1", "L9"]) | anything,
        "channel": st.sampled_from(["main", "nix"]) | anything,
        "adaptor": st.sampled_from(["simulated", "nix"]) | anything,
        "arguments": st.lists(st.text(max_size=5), max_size=3) | anything,
        "flor": anything,
    },
)


@given(content=st.fixed_dictionaries({}, optional={"robots": st.lists(entries, max_size=4), "defaults": entries}))
@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_is_written_gives_orders_or_one_line(tmp_path: Path, content: Any) -> None:
    try:
        found = orders(tmp_path, content)
    except MapFileError as error:
        assert len(str(error).splitlines()) == 1
        return
    assert len({order.name for order in found}) == len(found) <= MAX_ROBOTS
    assert all(order.floor in ("", *FLOORS) and order.channel in ("", *CHANNELS) for order in found)
    assert len(found) == sum(_count(entry) for entry in content["robots"])


def _count(entry: dict[str, Any]) -> int:
    return 1 if "name" in entry else int(entry["count"])


def test_any_order_of_robots_gives_the_same_orders(tmp_path: Path) -> None:
    robots: Sequence[dict[str, Any]] = [{"name": "A"}, {"prefix": "B", "count": 3}, {"name": "C", "floor": "L1"}]
    forward, backward = orders(tmp_path, {"robots": robots}), orders(tmp_path, {"robots": robots[::-1]})
    assert sorted(forward, key=lambda order: order.name) == sorted(backward, key=lambda order: order.name)
