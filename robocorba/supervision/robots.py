"""Robots that are started and ended on order, as processes of a system."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from robocorba.control import model_switcher
from robocorba.corba.orb import CONTEXT, Orb
from robocorba.corba.remote.omni_database import RemoteDatabase
from robocorba.errors.base import FieldError
from robocorba.errors.services import ProcessExists, UnknownProcess
from robocorba.errors.simulation import InvalidChoice
from robocorba.names import CHANNELS, ROBOTS
from robocorba.processes import RobotOrder
from robocorba.settings import Address
from robocorba.simulation.registry import Description
from robocorba.spatial.pose import Pose
from robocorba.supervision.launch import module_command
from robocorba.supervision.output import ReadyLine
from robocorba.supervision.process import ProcessSpec, Supervised

#: Maximum number of robots that a system has started, those that have ended included.
MAX_ROBOTS = 200
#: Maximum number of arguments for an adaptor, and of characters of all of them.
MAX_ARGUMENTS, MAX_ARGUMENTS_LENGTH = 64, 4096
#: Timeout to ask for floors and channels [s].
ASK_TIMEOUT_S = 2.0

_log = logging.getLogger(__name__)


class OrderChecker:
    """Checks orders against the running system. Thread-safe."""

    def __init__(self, orb: Orb) -> None:
        self._orb, self._database = orb, RemoteDatabase(orb, ASK_TIMEOUT_S)

    def __call__(self, order: RobotOrder) -> RobotOrder:
        """The order; a placed robot gets its floor by name. Raises InvalidChoice, NotReachable."""
        check_order(order)
        channels = self._orb.names(CHANNELS, ASK_TIMEOUT_S) if order.channel else []
        return checked_places(order, self._database.floors() if order.floor or order.at else [], channels)


def check_order(order: RobotOrder) -> None:
    """Check what needs no system. Raises InvalidChoice."""
    try:
        Description(order.name, Pose(order.floor, *(order.at or (0.0, 0.0, 0.0))))
    except FieldError as error:
        raise InvalidChoice(error.field, error.reason) from None
    if order.adaptor not in (known := model_switcher.installed()):
        raise InvalidChoice("adaptor", f"{order.adaptor[:80]!r} is not installed; there are {', '.join(known)}")
    arguments = order.adaptor_arguments
    if len(arguments) > MAX_ARGUMENTS or sum(map(len, arguments)) > MAX_ARGUMENTS_LENGTH:
        limits = f"{MAX_ARGUMENTS} with {MAX_ARGUMENTS_LENGTH} characters"
        raise InvalidChoice("adaptorArguments", f"more than {limits} in all")


def checked_places(order: RobotOrder, floors: Sequence[str], channels: Sequence[str]) -> RobotOrder:
    """The order with the name of its floor, if it has one. Raises InvalidChoice for an unknown floor or channel."""
    if order.floor and order.floor not in floors:
        raise InvalidChoice("onFloor", f"there is no floor {order.floor[:80]!r}; there are {_some(floors)}")
    if order.channel and order.channel not in channels:
        raise InvalidChoice("channel", f"there is no channel {order.channel[:80]!r}; there are {_some(channels)}")
    if order.at is None or order.floor:
        return order
    if not floors:
        raise InvalidChoice("onFloor", "the building has no floor")
    return replace(order, floor=floors[0])


def _some(names: Sequence[str]) -> str:
    return ", ".join(name[:60] for name in names[:10]) or "none"


def robot_spec(order: RobotOrder, state: Path, naming: Address, start_limit_s: float) -> ProcessSpec:
    """The process of a robot. It is ready when it says so: its name may still be bound by a former robot."""
    # With = no value can be taken for an option.
    options = [f"--adaptor={order.adaptor}", f"--naming={naming}", f"--state={state}"]
    options += [
        f"--{option}={value}" for option, value in (("floor", order.floor), ("channel", order.channel)) if value
    ]
    if order.at is not None:
        options.append("--at=" + ",".join(map(repr, order.at)))
    command = module_command("robocorba.clients.robot", order.name, *options, "--", *order.adaptor_arguments)
    output = ReadyLine(order.process)
    names = (f"{CONTEXT}/{ROBOTS}/{order.name}",)
    return ProcessSpec(order.process, command, state, output.probe, output, start_limit_s=start_limit_s, names=names)


@dataclass
class _Robot:
    process: Supervised
    task: asyncio.Task[None]
    is_stopping: bool = False


class Robots:
    """The robots of a system. To be used in the thread of the event loop, which must be the main one.

    spec_of: the process for an order. changed: called whenever a state has changed."""

    def __init__(self, spec_of: Callable[[RobotOrder], ProcessSpec], changed: Callable[[], None]) -> None:
        self._spec_of, self._changed = spec_of, changed
        self._robots: dict[str, _Robot] = {}

    @property
    def processes(self) -> list[Supervised]:
        """In the order of their starts; those that have ended by themselves stay until `end` or a new start."""
        return [robot.process for robot in self._robots.values()]

    def start(self, order: RobotOrder) -> None:
        """Start a robot. Raises ProcessExists, InvalidChoice."""
        former = self._robots.get(order.name)
        if former is not None and not former.task.done():
            raise ProcessExists(order.name)
        if former is None and len(self._robots) >= MAX_ROBOTS:
            raise InvalidChoice("name", f"this system has started {MAX_ROBOTS} robots, its limit; end one of them")
        self._robots.pop(order.name, None)
        process = Supervised(self._spec_of(order), self._changed)
        robot = self._robots[order.name] = _Robot(process, asyncio.create_task(process.run()))
        robot.task.add_done_callback(lambda task: self._ended(order.name, robot))
        self._changed()

    def end(self, name: str) -> None:
        """Begin to end a robot, or forget one that has ended. Raises UnknownProcess."""
        known = {robot.process.spec.name: key for key, robot in self._robots.items()}
        key = name if name in self._robots else known.get(name)
        if key is None:
            raise UnknownProcess(name)
        if self._robots[key].task.done():
            del self._robots[key]
            self._changed()
        else:
            self._stop(self._robots[key])

    async def close(self) -> None:
        """End all robots."""
        robots = list(self._robots.values())
        for robot in robots:
            self._stop(robot)
        for robot in robots:
            with contextlib.suppress(asyncio.CancelledError, Exception):
                await robot.task

    def _stop(self, robot: _Robot) -> None:
        if not robot.is_stopping:  # a second cancellation would end it without its time to log off
            robot.is_stopping = True
            robot.task.cancel()

    def _ended(self, name: str, robot: _Robot) -> None:
        process = robot.process
        if robot.is_stopping or robot.task.cancelled():
            if self._robots.get(name) is robot:
                del self._robots[name]
            self._changed()
            return
        if error := robot.task.exception():
            process.problem = str(error)
            _log.error("%s", error)
        process.set_state("ended", pid=0)
