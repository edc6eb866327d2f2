"""Emergency stops at the simulation server: it holds the robots' bodies, and calls the robots themselves.

A stop belongs to the robot's name: it holds every robot that logs on by it, until it is reset. A stop of all robots
has a latch of its own: while that is on, each robot that logs on gets a stop of its name. What must outlive the
server's process is in a file: for each name, and for ALL, the stops that hold it, and the reference of its robot's
stop target. With that file an operator can stop the robots, too, while the server does not answer. If it can't be
read, nobody knows who was stopped: that is a stop of all."""

from __future__ import annotations

import hashlib
import logging
import math
import os
import secrets
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, TypedDict

import msgspec

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.simulation import SessionExpired, UnknownRobot
from robocorba.simulation.registry import name_fault
from robocorba.system.background import Workers
from robocorba.system.damaged_files import set_aside
from robocorba.system.decoding import decode_json
from robocorba.system.repeating import Repeating
from robocorba.system.stop_latch import EMERGENCY_STOP, StopLatch

if TYPE_CHECKING:  # `robocorba stop` does without the physics
    from robocorba.simulation.session import Session

#: Maximum length of a reason [characters].
MAX_REASON = 200
#: Maximum number of names that are held while no robot is logged on by them: a stop of a robot that is just about to
#: log on is kept, and names that never existed fill no disk.
MAX_ABSENT = 1000
#: In place of a name: the stop of all robots. No robot can have this name.
ALL = "*"
#: How a stop of all ends.
UNTIL_RESET = "until: robocorba stop --all --reset"

_log = logging.getLogger(__name__)


class StopAnswer(NamedTuple):
    """What a robot says of its own stop. is_confirmed: its adaptor has confirmed it."""

    is_stopped: bool
    is_confirmed: bool
    reason: str = ""


class StopHold(NamedTuple):
    """What holds a robot's name. number: of its last stop."""

    is_held: bool
    number: int
    reason: str


NOT_HELD = StopHold(False, 0, "")


class StopState(NamedTuple):
    """What is known of a robot that is held. waits_for: why it does not stand yet, as far as is known; else empty."""

    robot: str
    is_held: bool
    stands: bool
    speed: float
    is_confirmed: bool
    waits_for: str


class StopEvent(TypedDict):
    """The payload of robot.stop. robots: names of those that are to stop; without any, all."""

    robots: list[str]
    reason: str


StopNumber = Annotated[int, msgspec.Meta(ge=0, le=2**53)]


class StopRecord(msgspec.Struct):
    """A name in the file. registration: identifies its session. target: URI, empty if it has reported none.

    stands_with_body: the robot is its body in the building. held: why it is held, empty if it is not. number: of its
    last stop; reasons: see StopLatch."""

    registration: str = ""
    target: str = ""
    stands_with_body: bool = True
    held: str = ""
    number: StopNumber = 0
    reasons: dict[str, StopNumber] = {}


class _Name:
    """A name with a robot that is logged on, or held. target: of the present session. called: the last stop for which
    the target was called; is_confirmed: it has confirmed one since the robot is held; problem: why it has not."""

    def __init__(self, latch: StopLatch | None = None) -> None:
        # A new one numbers its stops as no earlier one of its name did: the robot may remember their numbers.
        self.latch = latch or StopLatch(secrets.randbits(40))
        self._first = 0 if latch else self.latch.number
        self.registration = self.target = self.problem = ""
        self.stands_with_body = True
        self.called = 0
        self.is_calling = self.is_confirmed = False

    @property
    def hold(self) -> StopHold:
        return StopHold(self.latch.is_on, self.latch.number, self.latch.reason)

    def begin_session(self, registration: str, target: str = "", stands_with_body: bool = True) -> None:
        """A robot has logged on, or has reported its target."""
        self.registration, self.target, self.stands_with_body = registration, target, stands_with_body
        self.called, self.is_confirmed, self.problem = 0, False, ""

    @property
    def is_recorded(self) -> bool:
        """Whether the file has to have it. A robot without a target that was never stopped logs on without a write."""
        return bool(self.target) or self.latch.number > self._first

    @property
    def record(self) -> StopRecord:
        stops = self.latch.reason, self.latch.number, dict(self.latch.reasons)
        return StopRecord(self.registration, self.target, self.stands_with_body, *stops)


class EmergencyStops:
    """Thread-safe. sessions: the current ones. is_paused: whether simulated time stands still.

    call: stops a robot at the URI of its stop target, for a reason and with the number of the stop, and returns its
    answer; raises RoboCorbaError if it does not answer. publish: sends the event of a stop; must not block."""

    def __init__(
        self,
        file: Path,
        sessions: Callable[[], Iterable[Session]],
        is_paused: Callable[[], bool],
        call: Callable[[str, str, int], StopAnswer],
        publish: Callable[[Sequence[str], str], None] = lambda robots, reason: None,
    ) -> None:
        self._file, self._sessions, self._is_paused = file, sessions, is_paused
        self._call, self._publish = call, publish
        self._lock = threading.Lock()
        self._names: dict[str, _Name] = {}
        #: The stop of all robots.
        self._all = _Name(StopLatch())
        # 16 targets are called at a time: robots that hang hold up the calls of others that much less. A defect of a
        # call becomes the robot's `problem`; it is called again by the next stop.
        self._callers = Workers("emergency-stops", 16, lambda reason: None)
        #: Held while the file is written, which is apart from the lock: stops don't wait for a disk.
        self._writing = threading.Lock()
        self._written: object = None
        self._is_failing = self._is_closed = False
        # Another attempt to write the file after 0.2 s.
        self._writer = Repeating("stops file", self._write, lambda: 0.2 if self._is_failing else math.inf)

    def start(self) -> None:
        """Hold again what was held when the former server process ended; all robots, if that can't be read."""
        try:
            records = _read(self._file)
        except (OSError, msgspec.MsgspecError) as error:
            records = {}
            self._lose_file(error)
        with self._lock:
            for name, record in records.items():
                reasons = record.reasons or ({record.held: 1} if record.held else {})  # of the first release
                known = _Name(StopLatch(max(record.number, *reasons.values(), 0), reasons))
                if name == ALL:
                    self._all = known
                    continue
                known.begin_session(record.registration, record.target, record.stands_with_body)
                self._names[name] = known
        for session in self._sessions():
            self.admit(session)
        with self._lock:
            present = {session.name for session in self._sessions()}
            self._names = {name: known for name, known in self._names.items() if known.latch.is_on or name in present}
        self._writer.start()
        if self._all.latch.is_on and not records:
            self._write_now()

    def close(self) -> None:
        """Write the last stops; robots are stopped afterwards too, but no more targets are called."""
        with self._lock:
            self._is_closed = True
        self._callers.close(wait=False)
        self._writer.close()
        self._write()

    # ---- sessions ----

    def admit(self, session: Session) -> None:
        """A robot has logged on: stops of its name hold it, too."""
        with self._lock:
            known = self._of(session)
        session.robot.hold_by(known.latch)
        if known.is_recorded:
            self._writer.wake()

    def report_target(self, session: Session, target: str, stands_with_body: bool) -> None:
        """Set the URI at which a robot is stopped itself."""
        with self._lock:
            self._of(session).begin_session(registration(session), target, stands_with_body)
        self._writer.wake()

    def forget(self, session: Session) -> None:
        """A session has ended; stops of its name go on."""
        with self._lock:
            known = self._names.get(session.name)
            if known is None or known.registration != registration(session):
                return
            was_recorded = known.is_recorded
            if known.latch.is_on:
                known.registration = known.target = ""
            else:
                del self._names[session.name]
        if was_recorded:
            self._writer.wake()

    # ---- stops ----

    def stop(self, names: Sequence[str], reason: str) -> list[StopState]:
        """Stop robots by name, without names all, also those that log on later, until `end_stop_of_all`; returns what
        is known at once of those that are logged on. A name without a robot is held until one logs on, at most
        MAX_ABSENT of them.

        The stop has been written when this returns, if the file can be written."""
        reason = reason[:MAX_REASON] or EMERGENCY_STOP
        wanted = set(names)
        with self._lock:
            stopped = [session for session in self._sessions() if not wanted or session.name in wanted]
            present = {session.name: self._of(session) for session in stopped}
            absent = {name: known for name in wanted - present.keys() if (known := self._absent(name))}
            new = [name for name, known in present.items() if not known.latch.is_on]
            for known in (*present.values(), *absent.values()):
                known.is_confirmed &= known.latch.is_on
                known.latch.stop(reason)
            if not wanted:
                self._all.latch.stop(reason)
        for session in stopped:
            session.robot.hold_by(present[session.name].latch)
        self._call_targets(present)
        if new:
            self._publish(new if wanted else (), reason)
            _log.warning("emergency stop of %s: %s", ", ".join(new), reason)
        self._write_now()
        return [self.state(session) for session in stopped]

    def states(self, names: Sequence[str]) -> list[StopState]:
        """What is known of robots, without names of all; targets that have not confirmed are called again."""
        wanted = set(names)
        with self._lock:
            found = [session for session in self._sessions() if not wanted or session.name in wanted]
            held = {session.name: known for session in found if (known := self._of(session)).latch.is_on}
        self._call_targets(held)
        return [self.state(session) for session in found]

    def report_stop(self, session: Session, reason: str) -> tuple[bool, StopHold]:
        """A robot has been stopped at its own end. If nothing holds its name, a new stop does; returns whether it is
        one, and what holds it. It has been written when this returns, if the file can be written.

        Raises SessionExpired."""
        with self._lock:
            if session.client.is_logged_off:
                raise SessionExpired()
            known = self._of(session)
            is_new = not known.latch.is_on
            if is_new:
                known.is_confirmed = False
                known.called = known.latch.stop(reason[:MAX_REASON])
        session.robot.hold_by(known.latch)
        if is_new:
            _log.warning("emergency stop of %s, by itself: %s", session.name, known.latch.reason)
            self._write_now()
        return is_new, known.hold

    def hold(self, session: Session) -> StopHold:
        """What holds a robot."""
        with self._lock:
            return self._of(session).hold

    def end(self, session: Session, number: int) -> StopHold:
        """End the stops of a robot up to a number; returns what holds it still."""
        with self._lock:
            known = self._of(session)
            known.latch.end(number)
        self._write_now()
        return known.hold

    def reset(self, session: Session) -> None:
        """End all stops of a robot."""
        self.end(session, self.hold(session).number)

    def reset_robot(self, name: str) -> None:
        """End all stops of a name. Raises UnknownRobot if no robot is logged on by it and nothing holds it."""
        with self._lock:
            session = next((session for session in self._sessions() if session.name == name), None)
            if session is None and name not in self._names:
                raise UnknownRobot(name)
            known = self._names.pop(name) if session is None else self._of(session)
            known.latch.end(known.latch.number)
        self._write_now()

    @property
    def stop_of_all(self) -> StopHold:
        """What holds every robot that logs on."""
        return self._all.hold

    def end_stop_of_all(self, number: int) -> StopHold:
        """End the stops of all robots up to a number: robots that log on are free then, the others stay stopped until
        each is reset. Returns what holds still."""
        self._all.latch.end(number)
        self._write_now()
        return self.stop_of_all

    def state(self, session: Session) -> StopState:
        """What is known of a robot."""
        with self._lock:
            known = self._of(session)
            is_held = known.latch.is_on
            is_confirmed, problem = is_held and known.is_confirmed, known.problem
        ahead, left, turn = session.robot.state().velocity
        speed = math.hypot(ahead, left)
        # Speeds below which a body counts as standing [m/s, rad/s].
        body_stands = self._is_paused() or (speed < 0.01 and abs(turn) < 0.03)
        waits_for = ""
        if not is_held:
            waits_for = "it is not stopped"
        elif not body_stands:
            waits_for = f"it brakes, {speed:.2f} m/s"
        elif not (known.stands_with_body or is_confirmed):
            waits_for = "the actual robot has not confirmed the stop" + (f": {problem}" if problem else "")
        return StopState(session.name, is_held, not waits_for, speed, is_confirmed, waits_for)

    # ---- implementation ----

    def _of(self, session: Session) -> _Name:
        """Requires the lock."""
        known = self._names.get(session.name) or _Name()
        if known.registration != registration(session) and not session.client.is_logged_off:
            known.begin_session(registration(session))
            self._names[session.name] = known
            if self._all.latch.is_on:
                known.latch.stop(f"all robots are stopped, {UNTIL_RESET} ({self._all.latch.reason})")
        return known

    def _lose_file(self, error: Exception) -> None:
        """Nobody knows which robots the file held."""
        self._all = _Name()
        self._all.latch.stop(f"{self._file.name} could not be read: {str(error)[:MAX_REASON]}")
        consequence = f"all robots are stopped, {UNTIL_RESET}"
        try:
            set_aside(self._file, str(error), consequence)
        except OSError as again:
            _log.warning("%s can't be read, nor set aside (%s); %s", self._file, again.strerror, consequence)

    def _absent(self, name: str) -> _Name | None:
        """What holds a name without a robot; None if there is no room for it. Requires the lock."""
        if name not in self._names:
            absent = sum(not known.registration for known in self._names.values())
            if absent >= MAX_ABSENT or name_fault(name):
                return None
        return self._names.setdefault(name, _Name())

    def _call_targets(self, names: Mapping[str, _Name]) -> None:
        """Call the targets of robots that have not confirmed, or have not been called for their last stop."""
        with self._lock:
            for name, known in names.items():
                is_done = known.is_confirmed and known.called == known.latch.number
                if known.target and not (is_done or known.is_calling or self._is_closed):
                    known.is_calling = True
                    self._callers.submit(self._call_target, name, known)

    def _call_target(self, name: str, known: _Name) -> None:
        is_confirmed = True
        while is_confirmed:
            with self._lock:
                target, number, reason = known.target, known.latch.number, known.latch.reason
                is_done = known.is_confirmed and known.called == number
                if is_done or not reason or not target or self._is_closed:
                    break
            answer, problem = None, ""
            try:
                answer = self._call(target, reason, number)
            except RoboCorbaError as error:
                problem = str(error)
            except Exception as error:
                _log.exception("the call of a stop target ended by a defect")
                kind = type(error).__name__
                problem = f"internal fault in the call of its stop target ({kind}: {str(error)[:200]})"
            is_confirmed = answer is not None and answer.is_stopped and answer.is_confirmed
            with self._lock:
                if known.target == target and known.latch.is_on:
                    if problem not in ("", known.problem):
                        _log.warning("%s does not confirm its emergency stop: %s", name, problem)
                    known.problem = problem
                    if answer:
                        known.called, known.is_confirmed = number, is_confirmed
        with self._lock:
            known.is_calling = False

    def _write(self) -> None:
        with self._writing:
            with self._lock:
                records = {name: known.record for name, known in self._names.items() if known.is_recorded}
                if self._all.is_recorded:
                    records[ALL] = self._all.record
                content = msgspec.json.encode(records)
            if content == self._written:
                return
            try:
                new = self._file.with_suffix(".new")
                new.unlink(missing_ok=True)
                with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as out:
                    out.write(content)
                new.replace(self._file)
                self._written, self._is_failing = content, False
            except OSError as error:
                if not self._is_failing:
                    _log.warning("cannot write %s: %s; emergency stops work without it", self._file, error.strerror)
                self._is_failing = True

    def _write_now(self) -> None:
        """Write before an answer; if that fails, the writer tries again."""
        self._write()
        if self._is_failing:
            self._writer.wake()


def registration(session: Session) -> str:
    """Identifies a session without revealing its key."""
    return hashlib.sha256(f"stop {session.client.key}".encode()).hexdigest()[:32]


def read_records(file: Path) -> Mapping[str, StopRecord]:
    """The content of the file; empty if there is none or it can't be read. ALL is the stop of all robots."""
    try:
        return _read(file)
    except (OSError, msgspec.MsgspecError) as error:
        _log.warning("cannot read %s: %s", file, error)
        return {}


def _read(file: Path) -> Mapping[str, StopRecord]:
    """Raises OSError, MsgspecError."""
    try:
        return decode_json(file.read_bytes(), dict[str, StopRecord])
    except FileNotFoundError:
        return {}
