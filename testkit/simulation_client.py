"""Robots in a process of their own: python -m testkit.simulation_client NAMING

Its first line on stdin is rows of name, floor, x, y as JSON.

Prints `ready` when they are logged on, and then executes commands from stdin, one a line:

    drive         drive all robots in circles, and scan
    report        print a JSON report of the time since the last report

If the server does not answer, the process stops commanding and only reads the robots' states until the next `drive`. It
never logs its robots on again. Times are of CLOCK_MONOTONIC."""

from __future__ import annotations

import contextlib
import math
import sys
import threading
import time
from typing import Any

import msgspec
from omniORB import CORBA

from robocorba.orb.calls import describe
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.settings import Address

#: Speed [m/s] and turn [rad/s] of the robots.
SPEED, TURN = 0.5, 1.0
#: Validity of a command [s].
VALID_S = 0.5
#: Interval between commands [s].
COMMAND_INTERVAL_S = 0.1
#: A robot scans with every n-th command.
SCAN_EVERY = 3
GONE = (CORBA.COMM_FAILURE, CORBA.TRANSIENT, CORBA.TIMEOUT)
ROUND = RoboCorba.Velocity(SPEED, 0.0, TURN)
NO_MOUNT = RoboCorba.Mount(0.0, 0.0, 0.0)
LIMITS = RoboCorba.MotionLimits(1.0, 2.0, 2.0, 4.0)


class ClientRobot:
    """driving, resting: states since the last `drive`, and since the server was lost; each is time, x, y, speed,
    simulated time."""

    def __init__(self, server: Any, name: str, floor: str, x: float, y: float) -> None:
        pose = RoboCorba.Pose(floor, x, y, 0.0)
        self.name = name
        self.session = server.registerRobot(RoboCorba.RobotDescription(name, pose, 0.3, 50.0, LIMITS))
        self.sensor = self.session._get_sensor()
        self.laser = self.sensor.laser()
        self.driving: list[tuple[float, ...]] = []
        self.resting: list[tuple[float, ...]] = []

    def look(self) -> tuple[float, ...]:
        state = self.session.state()
        speed = math.hypot(state.moving.ahead, state.moving.left)
        return time.monotonic(), state.at.x, state.at.y, speed, state.time

    def scan(self) -> None:
        assert len(self.sensor.scan(self.session.state().at, NO_MOUNT, self.laser).distances) == self.laser.rays


class Robots:
    """All robots of this process. scans: their durations [s]. wrong: unexpected exceptions. lost: logged-off robots."""

    def __init__(self, robots: list[ClientRobot]) -> None:
        self._robots = robots
        self._lock = threading.Lock()
        self._is_driving = False
        self.scans: list[float] = []
        self.wrong: list[str] = []
        self.lost: set[str] = set()

    def drive(self) -> None:
        with self._lock:
            self._is_driving = True
            for robot in self._robots:
                robot.driving, robot.resting = [], []

    def report(self) -> dict[str, Any]:
        with self._lock:
            scans, self.scans = self.scans, []
            wrong, self.wrong = self.wrong, []
            robots = {
                robot.name: {"driving": robot.driving[-1:], "resting": robot.resting[:1] + robot.resting[-1:]}
                for robot in self._robots
            }
        return {"robots": robots, "lost": sorted(self.lost), "wrong": wrong, "scans": scans}

    def run(self) -> None:
        for number in range(sys.maxsize):
            with self._lock:
                for place, robot in enumerate(self._robots):
                    if robot.name not in self.lost:
                        self._guarded(robot, self._is_driving and (number + place) % SCAN_EVERY == 0)
            time.sleep(COMMAND_INTERVAL_S)

    def _guarded(self, robot: ClientRobot, is_to_scan: bool) -> None:
        try:
            if self._is_driving:
                robot.session.command(ROUND, VALID_S)
                robot.driving.append(robot.look())
            else:
                robot.resting.append(robot.look())
        except GONE:
            self._is_driving = False
            return
        except CORBA.OBJECT_NOT_EXIST:
            self.lost.add(robot.name)
            return
        except CORBA.Exception as error:
            self.wrong.append(describe(error))
        if is_to_scan:
            self._scan(robot)

    def _scan(self, robot: ClientRobot) -> None:
        began = time.monotonic()
        try:
            robot.scan()
        except RoboCorba.SensorBehind:
            pass  # as promised on a busy machine; the bench judges how long scans take
        except CORBA.Exception as error:
            with contextlib.suppress(CORBA.Exception):
                robot.session.heartbeat()  # a scan may fail only while the server does not answer
                self.wrong.append(f"a scan of {robot.name}: {describe(error)}")
        self.scans.append(time.monotonic() - began)


def main(naming: str) -> None:
    with Orb(Address.parse(naming)) as orb:
        server = orb.resolve("SimulationServer", RoboCorba.SimulationServer, 20.0)
        robots = Robots([ClientRobot(server, *row) for row in msgspec.json.decode(sys.stdin.readline())])
        threading.Thread(target=robots.run, daemon=True).start()
        print("ready", flush=True)
        for line in sys.stdin:
            if line == "drive\n":
                robots.drive()
            else:
                print(msgspec.json.encode(robots.report()).decode(), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
