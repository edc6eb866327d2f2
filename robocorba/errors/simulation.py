"""Errors of the simulation server, its Omni database, monitor and recordings."""

from __future__ import annotations

from robocorba.errors.base import FieldError, RoboCorbaError


class SimulationError(RoboCorbaError):
    """The simulated building refuses something."""


class InvalidDescription(FieldError, SimulationError):
    """A field of a robot's description is out of range: `field` says which, `reason` says why."""


class PlaceTaken(SimulationError):
    """A robot at `x`, `y` on `floor` would stand in `blocker`: a robot, an object, or what stands (empty)."""

    def __init__(self, floor: str, x: float, y: float, blocker: str) -> None:
        self.floor, self.x, self.y, self.blocker = floor, x, y, blocker
        super().__init__(f"{floor} ({x:g}, {y:g}) is not free: {blocker or 'a wall'}")


class NameTaken(SimulationError):
    """A robot called `name` is logged on."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"a robot called {name} is logged on already")


class ServerFull(SimulationError):
    """`now` robots are logged on, of `limit`; a slot may be free after `retry_s`."""

    def __init__(self, limit: int, now: int, retry_s: float) -> None:
        self.limit, self.now, self.retry_s = limit, now, retry_s
        super().__init__(f"{now} robots are logged on, {limit} may be; try again in {retry_s:.1f} s")


class SessionExpired(SimulationError):
    """The robot is not logged on any more."""

    def __init__(self) -> None:
        super().__init__("this robot is not logged on any more")


class UnknownRobot(SimulationError):
    """No robot called `name` is logged on."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"no robot called {name} is logged on")


class InvalidRide(FieldError, SimulationError):
    """A field of a call for an elevator can't be: `field` says which, `reason` says why."""


class ElevatorFull(SimulationError):
    """`limit` robots wait for `elevator`."""

    def __init__(self, elevator: str, limit: int) -> None:
        self.elevator, self.limit = elevator, limit
        super().__init__(f"{limit} robots wait for {elevator}")


class InvalidReservation(FieldError, SimulationError):
    """A field of a reservation of areas can't be: `field` says which, `reason` says why."""


class ReservationsFull(SimulationError):
    """`limit` robots have reserved areas, or wait for them."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        super().__init__(f"{limit} robots have reserved areas already")


class InvalidCommand(FieldError, SimulationError):
    """A command that can't be carried out: `field` says which part of it, `reason` says why."""


class CannotGrip(SimulationError):
    """`what` can't be gripped; `reason` says why."""

    def __init__(self, what: str, reason: str) -> None:
        self.what, self.reason = what, reason
        super().__init__(f"can't grip {what[:80]!r}: {reason}")


class InvalidPicture(FieldError, SimulationError):
    """`field` of a picture that was asked for is out of range."""


class InvalidChoice(FieldError, SimulationError):
    """What an administrator set is out of range: `field` says which, `reason` says why."""


class InvalidMission(FieldError, SimulationError):
    """`field` of a mission can't be kept."""


class StaleMission(SimulationError):
    """The mission is at version `current`: somebody else changed it."""

    def __init__(self, name: str, expected: int, current: int) -> None:
        self.name, self.expected, self.current = name, expected, current
        super().__init__(f"mission {name[:80]!r} is at version {current}, not {expected}")


class UnknownMission(SimulationError):
    """No mission has this name."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"there is no mission {name[:80]!r}")


class OutOfStep(SimulationError):
    """An update of `floor` begins at version `since`, but what is known is `version`: load the floor again."""

    def __init__(self, floor: str, version: int, since: int) -> None:
        self.floor, self.version, self.since = floor, version, since
        super().__init__(f"an update of {floor} begins at {since}; known is {version}")


class StateDamaged(SimulationError):
    """The file that the simulation keeps can't be used; `reason` says why."""

    def __init__(self, path: str, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{path}: {reason}")


class SimulationBusy(SimulationError):
    """The simulation did not get round to it; it was not done."""


class VideoError(SimulationError):
    """A video can't be written to `path`; `reason` says why."""

    def __init__(self, path: object, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{path}: {reason}")


class NoRide(SimulationError):
    """`robot` has no ride in `elevator`, or can't do this in the phase in which it is."""

    def __init__(self, robot: str, elevator: str) -> None:
        self.robot, self.elevator = robot, elevator
        super().__init__(f"{elevator} has no ride for {robot} in this phase")
