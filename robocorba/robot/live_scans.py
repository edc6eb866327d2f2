"""What the sensors of any robots see, for viewers: nobody is asked unless somebody reads."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.floor_update import BodyKind, FloorView
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import RAY_SENSORS, Mount, ScanSpec
from robocorba.system.background import Workers

#: Robots asked at a time, and by one reading; more take turns. 16 cost the console 6 % of a core.
ROBOTS_AT_ONCE = 16
#: By how much a robot at which somebody looks goes before others [s].
FIRST_S = 5.0
#: How long a reader waits for the answers of its round [s]: those that come later are there for the next one.
ANSWER_LIMIT_S = 0.05
#: Interval between questions to a robot whether its sensors are virtual, and after a failure [s].
AGAIN_S = 2.0
#: Rays around a sensor with which its scan is compared.
RAYS_AROUND = 720
#: Error of a robot's place [m] and heading [rad] in the map, by which a ray may miss an edge.
PLACE_ERROR_M, HEADING_ERROR_RAD = 0.1, math.radians(1.0)

#: Scans by virtual sensors of a mount and spec on these robots at their poses, at a simulated time [s].
VirtualScans = Callable[[Sequence[tuple[str, Pose]], float, ScanSpec, Mount], list[RobotScan]]


class SensedRobot(NamedTuple):
    """A robot on a floor. radius_m: of its body [m]. time: simulated time of its pose [s]."""

    name: str
    at: Pose
    radius_m: float
    time: float


def robots_on(view: FloorView) -> list[SensedRobot]:
    """All robots on a floor."""
    return [
        SensedRobot(
            body.name, Pose(view.floor, *(float(row[each]) for each in ("x", "y", "heading"))), body.radius_m, view.time
        )
        for body, row in zip(view.bodies.values(), view.motions, strict=True)
        if body.kind is BodyKind.ROBOT
    ]


@dataclass
class _Sensed:
    """What is known of a robot's sensors. is_virtual: None before that is known. scanned_at, own_at: when its scans
    were asked for last, and when its own sensors may be asked next [s]."""

    is_virtual: bool | None = None
    scanned_at: float = 0.0
    own_at: float = 0.0
    scans: list[RobotScan] = field(default_factory=list)


class LiveScans:
    """Asks sensors in threads of its own, ROBOTS_AT_ONCE at most, whenever somebody reads; `close` ends them.
    Thread-safe.

    own: the scans of a robot's own sensors, None for those of a robot that is its body in the building; it takes a
    second at most, and raises RoboCorbaError. virtual: scans of virtual sensors; raises RoboCorbaError. clock: returns
    the time [s]."""

    def __init__(
        self,
        own: Callable[[str], list[RobotScan] | None],
        virtual: VirtualScans,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._own, self._virtual, self._clock = own, virtual, clock
        self._workers = Workers("scans", ROBOTS_AT_ONCE, lambda reason: None)
        self._answered = threading.Condition()
        self._sensed: dict[str, _Sensed] = {}
        #: Robots whose own sensors are being asked; None for the virtual ones of all.
        self._asked: set[str | None] = set()

    @property
    def actual(self) -> frozenset[str]:
        """The robots that were read last whose sensors are known to be their own."""
        with self._answered:
            return frozenset(name for name, of in self._sensed.items() if of.is_virtual is False)

    def read(
        self,
        robots: Sequence[SensedRobot],
        limit_s: float | None = None,
        with_virtual: bool = True,
        first: Collection[str] = (),
    ) -> list[RobotScan]:
        """The latest scan of each sensor of these robots. Asks their sensors, and waits limit_s [s] at most, by default
        ANSWER_LIMIT_S. with_virtual: also those of virtual sensors. first: robots that go before others whose turn is
        at most FIRST_S earlier."""
        now = self._clock()
        with self._answered:
            known = {robot.name: robot for robot in robots}  # in a cabin one may be on two floors
            self._sensed = {name: self._sensed.get(name) or _Sensed() for name in known}
            turns = sorted(
                ((robot, self._sensed[name]) for name, robot in known.items()),
                key=lambda turn: turn[1].scanned_at - FIRST_S * (turn[0].name in first),
            )
            due = [(robot, of) for robot, of in turns if robot.name not in self._asked and now >= of.own_at]
            due = due[: max(0, ROBOTS_AT_ONCE - len(self._asked))]
            may_scan = with_virtual and None not in self._asked
            virtual = [turn for turn in turns if may_scan and turn[1].is_virtual][:ROBOTS_AT_ONCE]
            for _, of in (*virtual, *((robot, of) for robot, of in due if not of.is_virtual)):
                of.scanned_at = now
            asked: set[str | None] = {robot.name for robot, _ in due} | ({None} if virtual else set())
            self._asked |= asked
            for robot, of in due:
                self._workers.submit(self._ask, robot, of)
            if virtual:
                self._workers.submit(self._scan, virtual)
            self._answered.wait_for(lambda: not asked & self._asked, ANSWER_LIMIT_S if limit_s is None else limit_s)
            return [scan for of in self._sensed.values() for scan in of.scans]

    def close(self) -> None:
        """Wait for the questions in progress."""
        self._workers.close()

    # ---- in the threads ----

    def _ask(self, robot: SensedRobot, of: _Sensed) -> None:
        """Ask a robot's own sensors."""
        is_virtual, scans, pause_s = of.is_virtual, list[RobotScan](), AGAIN_S
        try:
            found = self._own(robot.name)
            is_virtual = found is None
            if found:
                scans, pause_s = self._marked(found, robot), 0.0
        except RoboCorbaError:
            pass  # a robot that does not answer is seen by its display
        finally:
            with self._answered:
                if not (of.is_virtual and is_virtual):
                    of.is_virtual, of.scans = is_virtual, scans
                of.own_at = self._clock() + pause_s
                self._end(robot.name)

    def _marked(self, scans: Sequence[RobotScan], robot: SensedRobot) -> list[RobotScan]:
        """At the time of the floor, with the rays marked that hit what no map has."""
        around: dict[tuple[float, float, float], Floats] = {}
        for mount in {scan.mount for scan in scans}:
            here = [scan for scan in scans if scan.mount == mount]
            reach_m = max(scan.range_m + scan.rim_m for scan in here)
            spec = ScanSpec(Fan(0.0, 2 * math.pi / RAYS_AROUND, RAYS_AROUND, reach_m))
            with contextlib.suppress(RoboCorbaError):  # then it is not known
                (seen,) = self._virtual([(robot.name, here[0].at)], robot.time, spec, Mount(*mount))
                around[mount] = seen.distances
        marks = [unmapped(scan, around[scan.mount]) if scan.mount in around else scan.unmapped for scan in scans]
        return [scan._replace(time=robot.time, unmapped=each) for scan, each in zip(scans, marks, strict=True)]

    def _scan(self, turns: Sequence[tuple[SensedRobot, _Sensed]]) -> None:
        """Scan for robots whose sensors are virtual: those that all programs ask."""
        found: dict[str, list[RobotScan]] = {robot.name: [] for robot, _ in turns}
        try:
            for sensor in RAY_SENSORS.values():
                for radius_m in {robot.radius_m if sensor.is_on_rim else 0.0 for robot, _ in turns}:
                    places = {
                        robot.name: robot for robot, _ in turns if not sensor.is_on_rim or robot.radius_m == radius_m
                    }
                    at = [(name, robot.at) for name, robot in places.items()]
                    for scan in self._virtual(at, 0.0, sensor.spec(radius_m), Mount()):
                        found[scan.robot].append(scan._replace(time=places[scan.robot].time))
        except RoboCorbaError:
            found = {name: [] for name in found}
        finally:
            with self._answered:
                for robot, of in turns:
                    if of.is_virtual:
                        of.scans = found[robot.name]
                self._end(None)

    def _end(self, asked: str | None) -> None:
        self._asked.discard(asked)
        self._answered.notify_all()


def unmapped(scan: RobotScan, around: Floats) -> NDArray[np.bool_]:
    """Which rays (n,) of a scan hit something nearer than what is known. around: (RAYS_AROUND,) distances [m] to that
    from the middle of the sensor, the first one in its heading, counter-clockwise.

    By errors of place and heading a ray may hit what is beside it; these and 4 sigma of the sensor's noise are
    tolerated."""
    sigma_m, relative, *_ = scan.noise
    step_rad, lengths = 2 * math.pi / len(around), scan.distances + scan.rim_m
    rays = np.rint((scan.first_rad + scan.step_rad * np.arange(len(lengths))) / step_rad).astype(int)
    aside_rad = HEADING_ERROR_RAD + PLACE_ERROR_M / np.maximum(lengths, 2 * PLACE_ERROR_M)
    aside = np.ceil(aside_rad / step_rad).astype(int)
    nearest = around[rays % len(around)]
    for shift in range(1, int(aside.max(initial=0)) + 1):
        beside = np.minimum(around[(rays + shift) % len(around)], around[(rays - shift) % len(around)])
        nearest = np.where(shift <= aside, np.minimum(nearest, beside), nearest)
    tolerance_m = PLACE_ERROR_M + 4.0 * (sigma_m + relative * scan.distances)
    return np.asarray(scan.hits & (lengths < nearest - tolerance_m))


def nearest(scans: Iterable[RobotScan], radius_m: float) -> tuple[float, str] | None:
    """The least distance [m] from the rim of a robot to what its sensors see, where they see nothing to the end of
    their reach; and seen by what: a `virtual` sensor, an `actual` one, or by that `in no map`. None without scans."""
    found = []
    for scan in scans:
        ahead, left, heading = scan.mount
        angles = heading + scan.first_rad + scan.step_rad * np.arange(len(scan.distances))
        lengths = scan.distances + scan.rim_m
        away = np.hypot(ahead + lengths * np.cos(angles), left + lengths * np.sin(angles))
        ray = int(away.argmin())
        is_strange = len(scan.unmapped) and scan.unmapped[ray]
        kind = "virtual" if scan.is_virtual else "in no map" if is_strange else "actual"
        found.append((max(0.0, float(away[ray]) - radius_m), kind))
    return min(found, default=None)
