"""Fleet files: robots one by one and in groups, in YAML of a strict schema.

defaults: {floor: L1, channel: main}
robots:
  - name: Guide
    at: [3.5, 2.5, 1.57]        # x, y [m] and heading [rad]
    program: drive.json         # relative to this file
  - prefix: R                   # R1 to R10, at free nodes of the map
    count: 10
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType

from robocorba.errors.maps import MapFileError
from robocorba.errors.robots import InvalidProgram
from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import InvalidChoice
from robocorba.map_editor.yaml_file import YamlFile, YamlLimits, read_yaml
from robocorba.robot import model_switcher
from robocorba.robot.programs import program
from robocorba.system.decoding import convert
from robocorba.system.logs import one_line
from robocorba.system.processes import RobotOrder
from robocorba.system.supervision.order_checker import check_order, checked_places
from robocorba.system.supervision.robots import MAX_ROBOTS


class InvalidFleet(ServiceError):
    """A robot of a fleet is impossible: `key` names what is wrong, empty for the whole fleet."""

    def __init__(self, key: str, reason: str) -> None:
        self.key, self.reason = key, reason
        super().__init__(f"{key}: {reason}" if key else reason)


class Defaults(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """What all robots share unless they say otherwise."""

    floor: str | UnsetType = UNSET
    channel: str | UnsetType = UNSET
    program: str | UnsetType = UNSET
    adaptor: str | UnsetType = UNSET
    arguments: Annotated[list[str], Meta(max_length=64)] | UnsetType = UNSET
    perceive: Literal["simulation", "sensors"] | UnsetType = UNSET


class Entry(Defaults, forbid_unknown_fields=True, kw_only=True):
    """A robot with a `name`, or `count` robots whose names are `prefix` and a number from 1 on."""

    name: str | UnsetType = UNSET
    at: Annotated[list[float], Meta(min_length=2, max_length=3)] | UnsetType = UNSET
    prefix: str | UnsetType = UNSET
    count: Annotated[int, Meta(ge=1, le=MAX_ROBOTS)] | UnsetType = UNSET

    @property
    def title(self) -> str:
        """The robot or the group in messages."""
        if self.name is not UNSET:
            return f"robot {self.name!r:.80}"
        return "a robot" if self.prefix is UNSET else f"robots {self.prefix!r:.80}"

    def names(self) -> list[str]:
        """Names of the robots. Raises InvalidFleet."""
        if self.name is not UNSET:
            for key in ("prefix", "count"):
                if getattr(self, key) is not UNSET:
                    raise InvalidFleet(key, "a robot with a name is no group")
            return [self.name]
        if self.prefix is UNSET or self.count is UNSET:
            raise InvalidFleet("", "needs a name, or prefix and count")
        if self.at is not UNSET and self.count > 1:
            raise InvalidFleet("at", "several robots can't start at the same place")
        return [f"{self.prefix}{number}" for number in range(1, self.count + 1)]


class FleetFile(msgspec.Struct, forbid_unknown_fields=True):
    """The content of a file."""

    robots: Annotated[list[Entry], Meta(min_length=1, max_length=MAX_ROBOTS)]
    defaults: Defaults = msgspec.field(default_factory=Defaults)


#: Makes the error for a robot of the fleet: the index of its entry, the key and the reason.
Complain = Callable[[int, str, str], Exception]


def read_fleet(file: Path) -> Callable[[Sequence[str], Sequence[str]], list[RobotOrder]]:
    """Read a file, and check what needs no system; returns `orders_of` for it, which needs floors and channels. Raises
    MapFileError, with line, key and robot."""
    try:
        source = read_yaml(file, YamlLimits(size_bytes=256 * 1024, values=20_000, depth=8))
    except MapFileError as error:
        raise _single_line(error) from None
    content = _converted(source)

    def complain(index: int, key: str, reason: str) -> MapFileError:
        found = source.data["robots"][index]
        is_default = key in source.data.get("defaults", {}) and key not in found
        path = f"$.defaults.{key}" if is_default else f"$.robots[{index}]" + (f".{key}" if key in found else "")
        named = reason if key in found or is_default or not key else f"{key}: {reason}"
        return _single_line(source.error(path, f"{content.robots[index].title}: {named}"))

    folder = file.absolute().parent
    orders_of(content, folder, complain)
    return lambda floors, channels: orders_of(content, folder, complain, floors, channels)


def group_of(options: Mapping[str, Any]) -> Callable[[Sequence[str], Sequence[str]], list[RobotOrder]]:
    """The same for one group of robots, with the keys of an entry. Raises InvalidFleet."""
    try:
        content = FleetFile([convert(options, Entry)])
    except msgspec.ValidationError as error:
        reason, _, path = str(error).partition(" - at `$.")
        raise InvalidFleet(path.rstrip("`"), reason) from None

    def complain(index: int, key: str, reason: str) -> InvalidFleet:
        return InvalidFleet(key, f"{content.robots[index].title}: {reason}")

    orders_of(content, Path.cwd(), complain)
    return lambda floors, channels: orders_of(content, Path.cwd(), complain, floors, channels)


def _converted(source: YamlFile) -> FleetFile:
    try:
        return source.convert(FleetFile)
    except MapFileError as error:
        index = error.key.removeprefix("robots[").partition("]")[0]
        if not error.key.startswith("robots[") or not index.isdecimal():
            raise _single_line(error) from None
        entry = source.data["robots"][int(index)]
        given = [entry.get(key) for key in ("name", "prefix")] if isinstance(entry, dict) else []
        names = [name for name in given if isinstance(name, str)]
        robot = f"robot {names[0]!r:.80}: " if names else ""
        raise _single_line(MapFileError(error.file, error.line, error.key, robot + error.reason)) from None


def _single_line(error: MapFileError) -> MapFileError:
    """Without line breaks, which keys and values of a file may have."""
    return MapFileError(one_line(error.file), error.line, one_line(error.key), one_line(error.reason))


def orders_of(
    fleet: FleetFile,
    folder: Path,
    complain: Complain,
    floors: Sequence[str] | None = None,
    channels: Sequence[str] | None = None,
) -> list[RobotOrder]:
    """The robots to start. folder: where paths of programs begin. floors, channels: of the running system, None to
    leave them unchecked. Raises what `complain` makes."""
    known: dict[str, int] = {}
    orders: list[RobotOrder] = []
    programs: dict[Path, str] = {}
    adaptors = model_switcher.installed()  # it looks at every package in the environment
    for index, entry in enumerate(fleet.robots):
        try:
            for order in _orders(entry, fleet.defaults, folder):
                if order.name in known:
                    key = "name" if entry.name else "prefix"
                    raise InvalidFleet(
                        key, f"{order.name} is the name of another robot too (robots[{known[order.name]}])"
                    )
                known[order.name] = index
                if len(known) > MAX_ROBOTS:
                    raise InvalidFleet("", f"more than {MAX_ROBOTS} robots, the limit")
                if order.program and order.program not in programs:
                    programs[order.program] = _problem_of(order.program)
                if order.program and (problem := programs[order.program]):
                    raise InvalidFleet("program", problem)
                check_order(order, adaptors)
                orders.append(order if floors is None else checked_places(order, floors, channels or ()))
        except InvalidFleet as error:
            raise complain(index, error.key, error.reason) from None
        except InvalidChoice as error:
            keys = {"adaptorArguments": "arguments", "onFloor": "floor", "x": "at", "y": "at", "heading": "at"}
            raise complain(index, keys.get(error.field, error.field), error.reason) from None
    return orders


def _orders(entry: Entry, defaults: Defaults, folder: Path) -> Iterator[RobotOrder]:
    given: dict[str, Any] = {**_given(defaults), **_given(entry)}
    for key, value in given.items():
        if any("\0" in text for text in (value if isinstance(value, list) else [value]) if isinstance(text, str)):
            raise InvalidFleet(key, "contains a null character")
    at = given.get("at")
    for name in entry.names():
        yield RobotOrder(
            name,
            given.get("adaptor", "simulated"),
            tuple(given.get("arguments", ())),
            given.get("floor", ""),
            (at[0], at[1], at[2] if len(at) > 2 else 0.0) if at else None,
            given.get("channel", ""),
            (folder / given["program"]) if given.get("program") else None,
            given.get("perceive", ""),
        )


def _given(options: Defaults) -> dict[str, Any]:
    return {key: value for key in options.__struct_fields__ if (value := getattr(options, key)) is not UNSET}


def _problem_of(file: Path) -> str:
    """Why a file is no program; empty if it is one."""
    try:
        program.load(file)
    except InvalidProgram as error:
        return f"{file}: {error}"
    except (OSError, ValueError) as error:
        return f"{file}: {getattr(error, 'strerror', '') or error}"
    return ""
