"""Errors of the simulation server, its Omni database, monitor and recordings."""

from __future__ import annotations

from robocorba.errors.base import FieldError, NamedError, RoboCorbaError, StructuredError
from robocorba.errors.places import place


class SimulationError(RoboCorbaError):
    """Root of the errors of the simulation."""


class InvalidDescription(FieldError, SimulationError):
    """A field of a robot's description is out of range: `field` names it, `reason` explains."""


class PlaceTaken(StructuredError, SimulationError):
    """Nothing can be put at `x`, `y` [m] on `floor` because of `blocker`: the name of a robot or an object there, empty
    for a static obstacle, or a reason in words."""

    floor: str
    x: float
    y: float
    blocker: str

    def __str__(self) -> str:
        return f"{place(self.floor, self.x, self.y)} is not free: {self.blocker or 'a wall'}"


class NameTaken(NamedError, SimulationError):
    """A robot called `name` is already logged on."""

    message = "a robot called {name} is already logged on"


class ServerFull(StructuredError, SimulationError):
    """All `limit` slots are taken (`now` robots are logged on); one may be free after `retry_s` [s]."""

    limit: int
    now: int
    retry_s: float
    message = "{now} robots are logged on, the limit is {limit}; try again in {retry_s:.1f} s"


class SessionExpired(SimulationError):
    """The robot is no longer logged on."""

    def __init__(self) -> None:
        super().__init__("this robot is no longer logged on; register it again")


class UnknownRobot(NamedError, SimulationError):
    """No robot called `name` is logged on."""

    message = "no robot called {name} is logged on"


class UnknownBody(NamedError, SimulationError):
    """No robot and no movable object is called `name`."""

    message = "there is no robot or movable object {name!q}"


class InvalidRide(FieldError, SimulationError):
    """A field of an elevator call is invalid: `field` names it, `reason` explains."""


class ElevatorFull(StructuredError, SimulationError):
    """`elevator` has `limit` calls already."""

    elevator: str
    limit: int
    message = "{elevator} has {limit} calls, its limit; try again later"


class InvalidReservation(FieldError, SimulationError):
    """A field of a reservation is invalid: `field` names it, `reason` explains."""


class ReservationsFull(StructuredError, SimulationError):
    """`limit` reservations are granted or waiting already."""

    limit: int
    message = "{limit} robots have reserved areas, the limit; try again later"


class InvalidCommand(FieldError, SimulationError):
    """A field of a velocity command is invalid: `field` names it, `reason` explains."""


class CannotGrip(StructuredError, SimulationError):
    """Object `what` cannot be gripped; `reason` explains."""

    what: str
    reason: str
    message = "cannot grip {what!q}: {reason}"


class InvalidPicture(FieldError, SimulationError):
    """`field` of a requested picture is out of range; `reason` explains."""


class InvalidChoice(FieldError, SimulationError):
    """A setting of the administrator is out of range: `field` names it, `reason` explains."""


class InvalidMission(FieldError, SimulationError):
    """`field` of a mission cannot be stored; `reason` explains."""


class NoRoom(InvalidMission):
    """A mission can't be stored beside the others: removing one makes room."""


class StaleMission(NamedError, SimulationError):
    """Mission `name` is at version `current`, not `expected`: another client changed it."""

    expected: int
    current: int
    message = "mission {name!q} is at version {current}, not {expected}; read it again"


class UnknownMission(NamedError, SimulationError):
    """No mission is called `name`."""

    message = "there is no mission {name!q}"


class NoLeader(StructuredError, SimulationError):
    """A robot can't lead a mission, or does not answer; `reason` explains."""

    reason: str
    message = "{reason}"


class UpdateMismatch(StructuredError, SimulationError):
    """An update of `floor` begins at version `since`, but the local copy is at `version`: load the whole floor."""

    floor: str
    version: int
    since: int
    message = "an update of {floor} begins at version {since}; the copy is at version {version}"


class InvalidRecording(StructuredError, SimulationError):
    """The recording `path` cannot be read or written; `reason` explains."""

    path: object
    reason: str
    message = "{path}: {reason}"


class SimulationBusy(SimulationError):
    """The simulation did not execute a call in time, or is shutting down."""


class NoRide(StructuredError, SimulationError):
    """`robot` has no ride in `elevator`, or its ride is in another phase."""

    robot: str
    elevator: str
    message = "{elevator} has no ride for {robot} in this phase"


class SensorRefused(NamedError, SimulationError):
    """The virtual sensor server `name` has not proved that it belongs to this system."""

    reason: str
    message = "virtual sensor server {name!q} is refused: {reason}"
