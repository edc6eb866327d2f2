"""Client of the sensors of any robots: by their agents, or the virtual ones at their places."""

from __future__ import annotations

import math
import threading
import time

from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import AdaptorFailed
from robocorba.map_editor.spatial.frames import turned
from robocorba.map_editor.spatial.pose import Pose
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import RemoteObject
from robocorba.robot.agent_state import AgentState
from robocorba.robot.corba import robot_states
from robocorba.robot.corba.senses import CALL_TIMEOUT_S, RemoteSenses
from robocorba.robot.live_scans import AGAIN_S, LiveScans
from robocorba.robot.senses import RangeSensor
from robocorba.simulation.corba.remote_lasers import RemoteLasers
from robocorba.simulation.robot_scans import MAX_SENSORS, RobotScan
from robocorba.stubs import RoboCorba
from robocorba.system.names import ROBOTS

#: Adaptor of robots that are their bodies in the building: they have the virtual sensors of that.
VIRTUAL = "simulated"
#: Most time between a scan and the state from which its place is computed [s].
MAX_APART_S = 0.5


def live_scans(orb: Orb) -> LiveScans:
    """Scans of all robots of the running system."""
    return LiveScans(_OwnScans(orb).of, RemoteLasers(orb).scans)


class _OwnScans:
    """The own sensors of all robots. Thread-safe."""

    def __init__(self, orb: Orb) -> None:
        self._orb, self._lock = orb, threading.Lock()
        #: Robots that have an agent, and when their names are read again [s].
        self._robots: dict[str, _Robot] = {}
        self._known_until = 0.0

    def of(self, robot: str) -> list[RobotScan] | None:
        """As `_Robot.scans`; None also for a robot without an agent."""
        with self._lock:  # others need these names, too
            if time.monotonic() >= self._known_until:
                self._known_until = time.monotonic() + AGAIN_S  # also if nobody answers: they go by the former ones
                names = self._orb.names(ROBOTS, CALL_TIMEOUT_S)
                self._robots = {name: self._robots.get(name) or _Robot(self._orb, name) for name in names}
            found = self._robots.get(robot)
        return found.scans() if found else None


class _Robot:
    """A robot's own sensors, by its agent. One thread at a time asks it."""

    def __init__(self, orb: Orb, name: str) -> None:
        self._orb, self._name, path = orb, name, f"{ROBOTS}/{name}"
        self._agent = RemoteObject(orb, path, RoboCorba.RobotAgent, f"robot {name}", CALL_TIMEOUT_S, CALL_TIMEOUT_S)
        self._senses: RemoteSenses | None = None
        #: The adaptor that has these sensors, and when they are read again [s]: a restart may change them.
        self._adaptor, self._known_until = "", 0.0

    def scans(self) -> list[RobotScan] | None:
        """The latest scan of each sensor, from where the robot was at that time by its own account; none without
        sensors that work, None for a robot with virtual ones. Raises NotReachable."""
        state = robot_states.agent_state_of(self._agent.call(lambda agent: agent._get_state()))
        if state.adaptor == VIRTUAL:
            return None
        try:
            if state.adaptor != self._adaptor or time.monotonic() >= self._known_until:
                self._senses = self._find_senses()
                self._adaptor, self._known_until = state.adaptor, time.monotonic() + AGAIN_S
            sensors = self._senses.sensors if self._senses else ()
            return [_scan(state, self._senses, sensor) for sensor in sensors[:MAX_SENSORS] if self._senses]
        except RoboCorbaError:
            self._known_until = 0.0
            return []

    def _find_senses(self) -> RemoteSenses | None:
        try:
            sensors = self._agent.call(lambda agent: agent._get_sensors())
        except CORBA.BAD_OPERATION:
            return None
        return RemoteSenses(self._orb, self._orb.uri(sensors)) if sensors else None


def _scan(state: AgentState, senses: RemoteSenses, sensor: RangeSensor) -> RobotScan:
    """A scan from where the robot was at its time: state and scan have the same clock, and may be a cycle apart."""
    spec, seen, actor = sensor.spec, senses.ranges(sensor.name), state.actor
    passed_s = max(-MAX_APART_S, min(seen.time - actor.time, MAX_APART_S))
    x, y = turned(actor.velocity[0], actor.velocity[1], actor.heading)
    at = Pose(
        state.at.floor, actor.x + x * passed_s, actor.y + y * passed_s, actor.heading + actor.velocity[2] * passed_s
    )
    if not all(map(math.isfinite, at[1:])):
        raise AdaptorFailed(f"its pose {tuple(at[1:])} is not finite")
    noise = spec.noise.sigma_m, spec.noise.relative, spec.noise.lost, spec.seed
    hits = seen.distances < spec.fan.range_m
    return RobotScan(state.name, seen.time, at, sensor.mount, *spec.frame, noise, seen.distances, hits, False)
