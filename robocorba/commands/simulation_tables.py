"""The state of a simulation as tables: in the terminal, in pipes, as JSON."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from rich.console import Group
from rich.text import Text

from robocorba.commands.tables import Sheet, snake_cased
from robocorba.commands.waiting import RETRY_TIMEOUT_S
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.floor_update import BodyKind, FloorView
from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_agent import displays
from robocorba.robot.corba.remote_scans import live_scans
from robocorba.robot.display import Display
from robocorba.robot.live_scans import ROBOTS_AT_ONCE, nearest, robots_on
from robocorba.simulation.corba.remote_database import CALL_TIMEOUT_S, RemoteFloors
from robocorba.simulation.corba.remote_simulation import simulation_server
from robocorba.system.logs import one_line

#: Longest wait for the scans of robots [s].
SCAN_LIMIT_S = 0.2
#: Fields of a robot, an elevator, a sensor server or the simulation server.
Row = dict[str, Any]


#: Rows of `server`, `robots`, `elevators` and `sensors`, in m, s, rad. A replay has neither server nor sensors.
Tables = Mapping[str, Sequence[Row]]


class RunningSimulation:
    """The running simulation on the given floors, or on all; reconnects after a failure."""

    def __init__(self, orb: Orb, floors: Sequence[str]) -> None:
        self._orb, self._floors = orb, RemoteFloors(orb, floors)
        #: What robots show on their touch panels, and when they are asked again [s, monotonic].
        self._displays: dict[str, Display | None] = {}
        self._ask_at = 0.0
        self._server = simulation_server(orb, RETRY_TIMEOUT_S, CALL_TIMEOUT_S)
        self._scans, self._has_scanned = live_scans(orb), False

    def close(self) -> None:
        self._scans.close()

    def read(self, resolve_timeout_s: float = RETRY_TIMEOUT_S) -> Tables:
        """Read the current state. Raises UnknownFloor, NotReachable."""
        self._floors.follow(resolve_timeout_s)
        views = list(self._floors.views.values())

        def read(server: Any) -> Tables:
            return {
                "server": [members(server._get_state())],
                "robots": clients(server.clients(), views),
                "elevators": elevators(views),
                "sensors": [sensor(state) for state in server.sensors()],
            }

        self._server.resolve_timeout_s = resolve_timeout_s
        tables = self._server.call(read)
        if tables["robots"] and time.monotonic() >= self._ask_at:
            self._ask_displays()
        seen, unseen = self._nearest(views), {"nearest": None, "nearest_is": ""}
        shown = [
            {**row, **seen.get(name := row["name"], unseen), "display": self._text(name)} for row in tables["robots"]
        ]
        return {**tables, "robots": shown}

    def _nearest(self, views: Iterable[FloorView]) -> dict[str, Row]:
        """What is nearest to robots by their sensors, as members of their rows; none for a robot without."""
        robots = [robot for view in views for robot in robots_on(view)]
        # At first it is asked whose sensors are virtual.
        rounds = 1 if self._has_scanned else 2 * math.ceil(len(robots) / ROBOTS_AT_ONCE)
        scans = [scan for number in range(rounds) for scan in self._scans.read(robots, SCAN_LIMIT_S)]
        self._has_scanned = True
        found = {
            robot.name: nearest((scan for scan in scans if scan.robot == robot.name), robot.radius_m)
            for robot in robots
        }
        return {name: {"nearest": each[0], "nearest_is": each[1]} for name, each in found.items() if each}

    def _ask_displays(self) -> None:
        """Ask all robots that have an agent what they show, at most once a second."""
        with contextlib.suppress(NotReachable):  # the naming service: then nobody says it
            self._displays = displays(self._orb)
        self._ask_at = time.monotonic() + 1.0

    def _text(self, robot: str) -> str:
        shown = self._displays.get(robot)
        return shown.text if shown else "no answer" if robot in self._displays else ""


# ---- state as rows ----


def members(struct: Any) -> Row:
    """Members of a struct of numbers and strings."""
    return dict(snake_cased(vars(struct)))


def robots(views: Iterable[FloorView]) -> list[Row]:
    """Robots on floors."""
    return [
        {
            "name": body.name,
            "floor": view.floor,
            **{member: float(motion[member]) for member in ("x", "y", "heading")},
            "speed": math.hypot(motion["vx"], motion["vy"]),
        }
        for view in views
        for body, motion in zip(view.bodies.values(), view.motions, strict=True)
        if body.kind is BodyKind.ROBOT
    ]


def clients(states: Iterable[Any], views: Sequence[FloorView]) -> list[Row]:
    """Logged-on robots (each a ClientState) on the given floors."""
    speeds = {row["name"]: row["speed"] for row in robots(views)}
    floors = {view.floor for view in views}
    found = []
    for state in states:
        row = members(state)
        at = row.pop("at")
        if at.floor in floors:
            found.append({**row, **members(at), "speed": speeds.get(state.name, 0.0)})
    return found


def elevators(views: Iterable[FloorView]) -> list[Row]:
    """Elevators that serve the floors; `cabin` is empty while it travels."""
    states = {name: state for view in views for name, state in view.elevators.items()}
    return [
        {
            "name": name,
            "cabin": state.floor,
            "height": state.height,
            "doors": state.doors.name,
            "opening": state.opening,
            "riders": list(state.riders),
            "queue": list(state.queue),
        }
        for name, state in states.items()
    ]


def sensor(state: Any) -> Row:
    """The row of a SensorState."""
    return {"name": state.name, **members(state.load), "robots": state.robots}


# ---- rows as tables ----


def _pace(value: float) -> str:
    return f"{value:g}" if value else "as fast as possible"


#: Columns of each table: title, key in the row, and format of the value.
_COLUMNS: dict[str, tuple[tuple[str, str, Callable[[Any], str]], ...]] = {
    "server": (
        ("robots", "robots", str),
        ("limit", "limit", str),
        ("time [s]", "time", "{:.1f}".format),
        ("pace", "pace", _pace),
        ("achieved", "achieved", "{:.2f}".format),
        ("paused", "paused", lambda value: "yes" if value else "no"),
        ("collisions", "collisions", str),
        ("events/s", "event_rate", "{:.1f}".format),
        ("map version", "map_version", str),
    ),
    "robots": (
        ("robot", "name", str),
        ("floor", "floor", str),
        ("x [m]", "x", "{:.2f}".format),
        ("y [m]", "y", "{:.2f}".format),
        ("heading [°]", "heading", lambda value: f"{math.degrees(value):.0f}"),
        ("speed [m/s]", "speed", "{:.2f}".format),
        ("silent [s]", "silent", "{:.2f}".format),
        ("calls/s", "call_rate", "{:.1f}".format),
        ("latency [ms]", "latency", lambda value: f"{value * 1000:.2f}"),
        ("served by", "sensor", str),
        ("nearest [m]", "nearest", lambda value: "" if value is None else f"{value:.2f}"),
        ("nearest is", "nearest_is", str),
        ("shows", "display", str),
    ),
    "elevators": (
        ("elevator", "name", str),
        ("cabin", "cabin", lambda value: value or "travelling"),
        ("height [m]", "height", "{:.2f}".format),
        ("doors", "doors", str.lower),
        ("open [%]", "opening", lambda value: f"{value * 100:.0f}"),
        ("riders", "riders", ", ".join),
        ("queue", "queue", ", ".join),
    ),
    "sensors": (
        ("sensor server", "name", str),
        ("robots", "robots", str),
        ("busy [%]", "busy", lambda value: f"{value * 100:.0f}"),
        ("lag [ms]", "lag", lambda value: f"{value * 1000:.0f}"),
        ("scans/s", "scan_rate", "{:.1f}".format),
    ),
}


#: Columns that narrow terminals leave out, first the first.
_SPARE = ("calls/s", "latency [ms]", "silent [s]", "served by", "nearest is", "heading [°]", "events/s", "achieved")


def sheets(tables: Tables) -> list[Sheet]:
    """The tables that have rows, as text."""
    found = []
    for kind, columns in _COLUMNS.items():
        if rows := tables.get(kind):
            shown = [column for column in columns if column[1] in rows[0]]
            cells = [[write(row[key]) for _, key, write in shown] for row in rows]
            found.append(Sheet([title for title, _, _ in shown], cells, _SPARE))
    return found


def as_json(tables: Tables) -> Row:
    """All tables of a running simulation. A robot's `at` and a sensor server's `load` are flattened, `speed`,
    `nearest`, `nearest_is` and `display` are added, doors have the names of elevator_state.Doors."""
    return {**tables, "server": tables["server"][0]}


def with_note(tables: Tables, note: str = "", style: str = "bold red") -> Group:
    """Tables for the terminal, with a note below."""
    return Group(*sheets(tables), *([Text(one_line(note), style)] if note else []))
