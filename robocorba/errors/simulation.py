"""Errors of the simulation server, its Omni database, monitor and recordings."""

from __future__ import annotations

from robocorba.errors.base import FieldError, RoboCorbaError
from robocorba.errors.places import place


class SimulationError(RoboCorbaError):
    """Root of the errors of the simulation."""


class InvalidDescription(FieldError, SimulationError):
    """A field of a robot's description is out of range: `field` names it, `reason` explains."""


class RobotKeptOut(InvalidDescription):
    """An administrator keeps robots called `name` out."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__("name", f"an administrator keeps {name} out, until `robocorba simulation admit {name}`")


class PlaceTaken(SimulationError):
    """Nothing can be put at `x`, `y` [m] on `floor` because of `blocker`: the name of a robot or an object there, empty
    for a static obstacle, or a reason in words."""

    def __init__(self, floor: str, x: float, y: float, blocker: str) -> None:
        self.floor, self.x, self.y, self.blocker = floor, x, y, blocker
        super().__init__(f"{place(floor, x, y)} is not free: {blocker or 'a wall'}")


class NameTaken(SimulationError):
    """A robot called `name` is already logged on."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"a robot called {name} is already logged on")


class ServerFull(SimulationError):
    """All `limit` slots are taken (`now` robots are logged on); one may be free after `retry_s` [s]."""

    def __init__(self, limit: int, now: int, retry_s: float) -> None:
        self.limit, self.now, self.retry_s = limit, now, retry_s
        super().__init__(f"{now} robots are logged on, the limit is {limit}; try again in {retry_s:.1f} s")


class SessionExpired(SimulationError):
    """The robot is no longer logged on."""

    def __init__(self) -> None:
        super().__init__("this robot is no longer logged on; register it again")


class UnknownRobot(SimulationError):
    """No robot called `name` is logged on."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"no robot called {name} is logged on")


class UnknownBody(SimulationError):
    """No robot and no movable object is called `name`."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"there is no robot or movable object {name[:80]!r}")


class InvalidRide(FieldError, SimulationError):
    """A field of an elevator call is invalid: `field` names it, `reason` explains."""


class ElevatorFull(SimulationError):
    """`elevator` has `limit` calls already."""

    def __init__(self, elevator: str, limit: int) -> None:
        self.elevator, self.limit = elevator, limit
        super().__init__(f"{elevator} has {limit} calls, its limit; try again later")


class InvalidReservation(FieldError, SimulationError):
    """A field of a reservation is invalid: `field` names it, `reason` explains."""


class ReservationsFull(SimulationError):
    """`limit` reservations are granted or waiting already."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        super().__init__(f"{limit} robots have reserved areas, the limit; try again later")


class InvalidCommand(FieldError, SimulationError):
    """A field of a velocity command is invalid: `field` names it, `reason` explains."""


class CannotGrip(SimulationError):
    """Object `what` cannot be gripped; `reason` explains."""

    def __init__(self, what: str, reason: str) -> None:
        self.what, self.reason = what, reason
        super().__init__(f"cannot grip {what[:80]!r}: {reason}")


class InvalidPicture(FieldError, SimulationError):
    """`field` of a requested picture is out of range; `reason` explains."""


class InvalidChoice(FieldError, SimulationError):
    """A setting of the administrator is out of range: `field` names it, `reason` explains."""


class InvalidMission(FieldError, SimulationError):
    """`field` of a mission cannot be stored; `reason` explains."""


class NoRoom(InvalidMission):
    """A mission can't be stored beside the others: removing one makes room."""


class StaleMission(SimulationError):
    """Mission `name` is at version `current`, not `expected`: another client changed it."""

    def __init__(self, name: str, expected: int, current: int) -> None:
        self.name, self.expected, self.current = name, expected, current
        super().__init__(f"mission {name[:80]!r} is at version {current}, not {expected}; read it again")


class UnknownMission(SimulationError):
    """No mission is called `name`."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"there is no mission {name[:80]!r}")


class NoLeader(SimulationError):
    """A robot can't lead a mission, or does not answer; `reason` explains."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


class UpdateMismatch(SimulationError):
    """An update of `floor` begins at version `since`, but the local copy is at `version`: load the whole floor."""

    def __init__(self, floor: str, version: int, since: int) -> None:
        self.floor, self.version, self.since = floor, version, since
        super().__init__(f"an update of {floor} begins at version {since}; the copy is at version {version}")


class InvalidRecording(SimulationError):
    """The recording `path` cannot be read or written; `reason` explains."""

    def __init__(self, path: object, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{path}: {reason}")


class SimulationBusy(SimulationError):
    """The simulation did not execute a call in time, or is shutting down."""


class VideoError(SimulationError):
    """A video cannot be written to `path`; `reason` explains."""

    def __init__(self, path: object, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{path}: {reason}")


class NoRide(SimulationError):
    """`robot` has no ride in `elevator`, or its ride is in another phase."""

    def __init__(self, robot: str, elevator: str) -> None:
        self.robot, self.elevator = robot, elevator
        super().__init__(f"{elevator} has no ride for {robot} in this phase")


class SensorRefused(SimulationError):
    """The virtual sensor server `name` has not proved that it belongs to this system."""

    def __init__(self, name: str, reason: str) -> None:
        self.name, self.reason = name, reason
        super().__init__(f"virtual sensor server {name[:80]!r} is refused: {reason}")
