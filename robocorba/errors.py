"""Every error that RoboCorba raises on purpose, one tree with a sentence each.

RoboCorbaError
├── MapError
│   ├── InvalidElement        an element breaks a rule of the building
│   ├── UnknownElement        nothing has this kind, floor and name
│   ├── DuplicateElement      something has this kind, floor and name already
│   ├── StaleEdit             the element changed since the editor read it
│   ├── StaleVersion          the building changed since the editor looked
│   ├── NothingToUndo, NothingToRedo
│   ├── VersionUnavailable    the history does not reach back (or forward) that far
│   ├── TransactionClosed, TooManyTransactions
│   └── MapFileError          a map file is wrong: file, line, key, reason
├── PathError
│   ├── InvalidPoint          a coordinate is not a finite number in range
│   ├── InvalidRequest        a field of the request is out of range
│   ├── UnknownFloor          the building has no such floor
│   ├── NotFree               start or goal is too near to an obstacle
│   └── NoPath                nothing leads there: the blockers are named
├── SensingError
│   ├── InvalidScan           a field of a scan's request is out of range
│   └── SensorBehind          what the sensor knows is too old
├── SimulationError
│   ├── InvalidDescription    a field of a robot's description is out of range
│   ├── PlaceTaken            a robot would stand in something there
│   ├── NameTaken             a robot of this name is logged on
│   ├── ServerFull            as many robots are logged on as may be: the limit, how many, when to try again
│   ├── SessionExpired        the robot is not logged on any more
│   ├── UnknownRobot          no robot of this name is logged on
│   ├── InvalidCommand        a velocity, or how long it shall hold, can't be
│   ├── CannotGrip            the object is out of reach, or can't be moved
│   ├── InvalidRide           a field of a call for an elevator can't be
│   ├── ElevatorFull          too many robots wait for it
│   ├── InvalidReservation    a field of a reservation of areas can't be
│   ├── ReservationsFull      too many robots have reserved areas
│   ├── NoRide                a robot has no ride, or not in this phase
│   ├── InvalidChoice         an administrator set what can't be
│   ├── InvalidMission, StaleMission, UnknownMission
│   ├── InvalidPicture        a picture of a floor can't be drawn like this
│   ├── VideoError, StateDamaged   a film can't be written, a recording not be read
│   ├── OutOfStep             an update of a floor does not follow what is known
│   └── SimulationBusy        there was no time for it; nothing was done
├── RobotError
│   ├── InvalidProgram        an icon of a program can't be: which one, which parameter, and why
│   ├── Unreachable           a hand can't get there
│   ├── IllegalOrder          the robot can't do this now
│   ├── UnknownAdaptor        no adaptor has this name
│   ├── UnknownPlan           the data pool holds no plan of this name
│   ├── InvalidPlan, StalePlan
│   ├── InvalidCarry          so many robots can't carry this
│   ├── ImpossibleCarry       an object can't be carried there: the door, elevator or turn that blocks is named
│   ├── MotionFailed          the robot did not get where it should
│   ├── MissionFailed         what robots do together came to nothing: why, who, where
│   └── AdaptorFailed         the robot does not do what it is told
│       ├── UnitFailed        a unit of the actual robot refuses: which one, its code, and why
│       └── RobotLost         nobody answers any more; it may come back
├── EventError
│   ├── InvalidEvent          a field of an event is out of range
│   ├── InvalidSubscription   a subscription can't be used: where in it, and why
│   ├── InvalidQueue          a queue can't be made like this
│   ├── TooManyProxies        the channel serves as many clients as it may
│   ├── AlreadyConnected      the proxy has its client
│   ├── Disconnected          the proxy has no client, or has none any more
│   ├── ProxyGone             the proxy was disconnected, or its channel destroyed
│   ├── UnknownSubscription   no durable subscription has this name
│   ├── UnknownPeer           the channel has no such peer
│   ├── InvalidPeer           a peer can't be linked
│   ├── SessionOver           a gateway's session has ended; it has to join again
│   ├── NotDelivered          a client did not get an event: try again
│   ├── Unconfirmed           a client may have got an event: the answer did not come
│   ├── Refused               a client answered an event with an exception, or could not take it
│   └── ClientGone            a client ended its connection
└── ServiceError
    ├── AlreadyRunning        another process uses this state folder
    ├── PortInUse             somebody else listens there
    ├── StateMismatch         the state folder holds another building
    ├── StartFailed           a process did not come up in time
    ├── InvalidSetting        a variable or an option can't be used (in settings.py)
    └── NotReachable          a name could not be resolved or did not answer in time
"""

from __future__ import annotations

from collections.abc import Sequence


class RoboCorbaError(Exception):
    """Root of the tree."""


class FieldError(RoboCorbaError):
    """Part of what was asked for can't be: `field` says which, `reason` says why."""

    def __init__(self, field: str, reason: str) -> None:
        self.field, self.reason = field, reason
        super().__init__(f"{field}: {reason}")


class MapError(RoboCorbaError):
    """The map building agent refuses something."""


class InvalidElement(MapError):
    """An element breaks a rule: `kind`, `floor` and `name` say which, `reason` says why."""

    def __init__(self, kind: str, floor: str, name: str, reason: str) -> None:
        self.kind, self.floor, self.name, self.reason = kind, floor, name, reason
        super().__init__(f"{describe(kind, floor, name)}: {reason}")


class UnknownElement(MapError):
    """Nothing has this kind, floor and name."""

    def __init__(self, kind: str, floor: str, name: str) -> None:
        self.kind, self.floor, self.name = kind, floor, name
        super().__init__(f"there is no {describe(kind, floor, name)}")


class DuplicateElement(MapError):
    """Something has this kind, floor and name already."""

    def __init__(self, kind: str, floor: str, name: str) -> None:
        self.kind, self.floor, self.name = kind, floor, name
        super().__init__(f"there is a {describe(kind, floor, name)} already")


class StaleEdit(MapError):
    """The element is at version `current`, the edit was made for version `expected`."""

    def __init__(self, kind: str, floor: str, name: str, expected: int, current: int) -> None:
        self.kind, self.floor, self.name = kind, floor, name
        self.expected, self.current = expected, current
        super().__init__(
            f"{describe(kind, floor, name)} is at version {current}, the edit was made for version {expected}"
        )


class StaleVersion(MapError):
    """The building is at version `current`, the caller saw version `expected`."""

    def __init__(self, expected: int, current: int) -> None:
        self.expected, self.current = expected, current
        super().__init__(f"the building is at version {current}, the request was made for version {expected}")


class NothingToUndo(MapError):
    """No edit is left to take back."""


class NothingToRedo(MapError):
    """No edit that was taken back is left to repeat."""


class VersionUnavailable(MapError):
    """The kept history covers `oldest` to `current`; `version` lies outside."""

    def __init__(self, version: int, oldest: int, current: int) -> None:
        self.version, self.oldest, self.current = version, oldest, current
        super().__init__(f"version {version} is outside the kept history {oldest} to {current}")


class TransactionClosed(MapError):
    """The transaction was committed, rolled back or has timed out."""


class TooManyTransactions(MapError):
    """`limit` transactions are open already."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        super().__init__(f"{limit} transactions are open already; commit or roll back one")


class MapFileError(MapError):
    """A map file is wrong. `line` is 1-based, 0 where no line can be named; `key` is a path such as floors[0].name."""

    def __init__(self, file: str, line: int, key: str, reason: str) -> None:
        self.file, self.line, self.key, self.reason = file, line, key, reason
        where = f"{file}:{line}" if line else file
        super().__init__(f"{where}: {key}: {reason}" if key else f"{where}: {reason}")


class PathError(RoboCorbaError):
    """The path planning agent refuses or fails."""


class InvalidPoint(PathError):
    """`which` is start or goal, `field` the member that is wrong."""

    def __init__(self, which: str, field: str, reason: str) -> None:
        self.which, self.field, self.reason = which, field, reason
        super().__init__(f"{which}.{field}: {reason}")


class InvalidRequest(FieldError, PathError):
    """`field` is the member of the request that is wrong."""


class UnknownFloor(PathError):
    """`which` is start, goal or an area; `known` lists the floors there are."""

    def __init__(self, which: str, floor: str, known: Sequence[str]) -> None:
        self.which, self.floor, self.known = which, floor, tuple(known)
        super().__init__(f"{which}: there is no floor {floor!r}; known are {', '.join(self.known)}")


class NotFree(PathError):
    """The robot does not fit at start or goal: `clearance_m` to `obstacle`, `required_m` needed."""

    def __init__(
        self, which: str, floor: str, x: float, y: float, obstacle: str, clearance_m: float, required_m: float
    ) -> None:
        self.which, self.floor, self.x, self.y = which, floor, x, y
        self.obstacle, self.clearance_m, self.required_m = obstacle, clearance_m, required_m
        super().__init__(
            f"{which} {floor}:{x:g},{y:g} is not free: {clearance_m:.3f} m to {obstacle}, {required_m:.3f} m needed"
        )


class Blocker:
    """One thing that stands in the way of every path."""

    def __init__(self, kind: str, floor: str, name: str, reason: str) -> None:
        self.kind, self.floor, self.name, self.reason = kind, floor, name, reason

    def __str__(self) -> str:
        return f"{describe(self.kind, self.floor, self.name)}: {self.reason}"


class NoPath(PathError):
    """Nothing leads from start to goal; `blockers` names what stands in the way."""

    def __init__(self, reason: str, blockers: Sequence[Blocker] = ()) -> None:
        self.reason, self.blockers = reason, tuple(blockers)
        super().__init__("; ".join([reason, *map(str, self.blockers)]))


class PlanningTimeout(PathError):
    """A query was given up when its time was over; `floor` is the floor that was searched."""

    def __init__(self, floor: str) -> None:
        self.floor = floor
        super().__init__(f"the search on floor {floor} ran out of time; ask for a shorter way, or raise the deadline")


class SensingError(RoboCorbaError):
    """A virtual sensor refuses something."""


class InvalidScan(FieldError, SensingError):
    """A field of a scan's request is out of range: `field` says which, `reason` says why."""


class SensorBehind(SensingError):
    """What the sensor knows is `lag_s` old, more than `limit_s`."""

    def __init__(self, lag_s: float, limit_s: float) -> None:
        self.lag_s, self.limit_s = lag_s, limit_s
        super().__init__(f"what the sensor knows is {lag_s:.2f} s old, more than {limit_s:g} s")


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


class RobotError(RoboCorbaError):
    """A robot client refuses or fails."""


class InvalidProgram(RobotError):
    """`icon` is a path into the program, such as icons[2].icons[0], empty for the program as a whole; `parameter` names
    what is wrong in it."""

    def __init__(self, icon: str, parameter: str, reason: str) -> None:
        self.icon, self.parameter, self.reason = icon, parameter, reason
        where = ".".join(filter(None, (icon, parameter)))
        super().__init__(f"{where}: {reason}" if where else reason)


class Unreachable(RobotError):
    """`hand` (left or right) can't get where it shall."""

    def __init__(self, hand: str, reason: str) -> None:
        self.hand, self.reason = hand, reason
        super().__init__(f"the {hand} hand: {reason}")


class IllegalOrder(RobotError):
    """The robot can't do what was asked for in the `condition` that it is in."""

    def __init__(self, order: str, condition: str) -> None:
        self.order, self.condition = order, condition
        super().__init__(f"can't {order}: the robot {condition}")


class UnknownAdaptor(RobotError):
    """No adaptor is called `name`; `known` lists those that are installed."""

    def __init__(self, name: str, known: Sequence[str]) -> None:
        self.name, self.known = name, tuple(known)
        super().__init__(f"there is no adaptor {name[:80]!r}; known are {', '.join(self.known)}")


class UnknownPlan(RobotError):
    """The data pool holds no plan of this name."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"there is no plan {name[:80]!r}")


class InvalidPlan(FieldError, RobotError):
    """`field` of a cooperative plan can't be kept."""


class StalePlan(RobotError):
    """The plan is at version `current`: somebody else changed it."""

    def __init__(self, name: str, expected: int, current: int) -> None:
        self.name, self.expected, self.current = name, expected, current
        super().__init__(f"plan {name[:80]!r} is at version {current}, not {expected}")


class InvalidCarry(FieldError, RobotError):
    """`field` of a carry can't be: `reason` says why."""


class ImpossibleCarry(RobotError):
    """An object can't be carried there by so many robots; `blockers` names what stands in the way."""

    def __init__(self, reason: str, blockers: Sequence[Blocker] = ()) -> None:
        self.reason, self.blockers = reason, tuple(blockers)
        super().__init__("; ".join([reason, *map(str, self.blockers)]))


class MotionFailed(RobotError):
    """The robot did not get where it should."""


class MissionFailed(RobotError):
    """A mission came to nothing; nothing was left in the hands of its robots."""


class AdaptorFailed(RobotError):
    """The robot behind an adaptor does not do what it is told; `cause` says why."""

    def __init__(self, cause: str) -> None:
        self.cause = cause
        super().__init__(cause)


class UnitFailed(AdaptorFailed):
    """`unit` of the actual robot refused: its return or state code, and why."""

    def __init__(self, unit: str, code: int, reason: str) -> None:
        self.unit, self.code = unit, code
        super().__init__(f"{unit}: {reason} ({code})")


class RobotLost(AdaptorFailed):
    """Nobody answers for the robot any more; once somebody does again, it can be started again."""


class EventError(RoboCorbaError):
    """The event channel refuses something, or could not reach a client of it."""


class InvalidEvent(FieldError, EventError):
    """`field` of the event's header, or its payload, is out of range."""


class InvalidSubscription(EventError):
    """`where` is a path into the subscription, such as [1].patterns[0].type."""

    def __init__(self, where: str, reason: str) -> None:
        self.where, self.reason = where, reason
        super().__init__(f"{where}: {reason}" if where else reason)


class InvalidQueue(FieldError, EventError):
    """`field` of the queue's policy is out of range."""


class TooManyProxies(EventError):
    """The channel has `limit` proxies already."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        super().__init__(f"the channel has {limit} proxies already")


class AlreadyConnected(EventError):
    """The proxy is connected already."""


class Disconnected(EventError):
    """The proxy is not connected."""


class ProxyGone(EventError):
    """The proxy was disconnected, or its channel was destroyed."""


class UnknownSubscription(EventError):
    """No durable subscription has this name."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"there is no durable subscription {name[:80]!r}")


class UnknownPeer(EventError):
    """The channel is not linked with `peer`; `known` lists those that it is linked with."""

    def __init__(self, peer: str, known: Sequence[str]) -> None:
        self.peer, self.known = peer, tuple(known)
        super().__init__(f"{peer[:80]!r} is not a peer; peers are {', '.join(self.known) or 'none'}")


class InvalidPeer(FieldError, EventError):
    """`field` of a peer's address can't be used."""


class SessionOver(EventError):
    """Another join of the same gateway came later, or the feed was restarted."""


class NotDelivered(EventError):
    """It is certain that the client did not get the events."""


class Unconfirmed(EventError):
    """The events were sent, the answer did not come; the client may have them or not."""


class Refused(EventError):
    """The client answered with an exception, or the event can't be sent to it: another attempt would end likewise."""


class ClientGone(EventError):
    """The client says that it is disconnected, or that it does not exist."""


class ServiceError(RoboCorbaError):
    """A process or its surroundings are not as they must be."""


class AlreadyRunning(ServiceError):
    """Another process uses this state folder."""


class PortInUse(ServiceError):
    """Somebody else listens on `host`:`port`."""

    def __init__(self, host: str, port: int, purpose: str) -> None:
        self.host, self.port, self.purpose = host, port, purpose
        super().__init__(f"port {port} on {host}, wanted for {purpose}, is in use; choose another one")


class StateMismatch(ServiceError):
    """The state folder holds another building than the one asked for."""


class StartFailed(ServiceError):
    """A process did not come up in time."""


class NotReachable(ServiceError):
    """A name could not be resolved, or its object did not answer, in time."""


def describe(kind: str, floor: str, name: str) -> str:
    """'wall w1 on L2', 'elevator E1': how messages name an element."""
    subject = f"{kind} {_short(name)!r}" if name else kind
    return f"{subject} on {_short(floor)}" if floor else subject


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:60]}… ({len(text)} characters)"
