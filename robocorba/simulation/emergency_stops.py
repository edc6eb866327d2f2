"""Emergency stops at the simulation server: it holds the robots' bodies, and calls the robots themselves.

A stop belongs to the robot's name: it holds whoever logs on by it, until it is reset. What must outlive the server's
process is in a file: for each name the stops that hold it, and the reference of its robot's stop target. With that file
an operator can stop the robots, too, while the server does not answer."""

from __future__ import annotations

import hashlib
import logging
import math
import os
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypedDict

import msgspec

from robocorba.background import Workers
from robocorba.decoding import decode_json
from robocorba.errors.simulation import SessionExpired, UnknownRobot
from robocorba.repeating import Repeating
from robocorba.simulation.registry import name_fault
from robocorba.stop_latch import EMERGENCY_STOP, StopLatch

if TYPE_CHECKING:  # `robocorba stop` does without the physics
    from robocorba.simulation.session import Session

#: Speed below which a body counts as standing [m/s, rad/s].
STANDING_SPEED, STANDING_TURN = 0.01, 0.03
#: Number of stop targets that are called at a time. Robots that hang hold up the calls of others that much less.
CALLERS = 16
#: Pause before another attempt to write the file [s].
RETRY_S = 0.2
#: Maximum length of a reason [characters].
MAX_REASON = 200
#: Maximum number of names that are held while no robot is logged on by them: a stop of a robot that is just about to
#: log on is kept, and names that never existed fill no disk.
MAX_ABSENT = 1000

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


class StopRecord(msgspec.Struct):
    """A name in the file. registration: identifies its session. target: URI, empty if it has reported none.

    stands_with_body: the robot is its body in the building. held: why it is held, empty if it is not. number: of its
    last stop; reasons: see StopLatch."""

    registration: str = ""
    target: str = ""
    stands_with_body: bool = True
    held: str = ""
    number: int = 0
    reasons: dict[str, int] = {}


class _Name:
    """A name with a robot that is logged on, or held. target: of the present session. called: the last stop for which
    the target was called; is_confirmed: it has confirmed one since the robot is held."""

    def __init__(self, latch: StopLatch | None = None) -> None:
        self.latch = latch or StopLatch()
        self.registration = self.target = ""
        self.stands_with_body = True
        self.called = 0
        self.is_calling = self.is_confirmed = False

    @property
    def hold(self) -> StopHold:
        return StopHold(self.latch.is_on, self.latch.number, self.latch.reason)

    @property
    def record(self) -> StopRecord:
        latch = self.latch
        return StopRecord(
            *(self.registration, self.target, self.stands_with_body),
            *(latch.reason, latch.number, dict(latch.reasons)),
        )


class EmergencyStops:
    """Thread-safe. sessions: the current ones. is_paused: whether simulated time stands still.

    call: stops a robot at the URI of its stop target, for a reason and with the number of the stop, and returns its
    answer; raises any exception if it does not answer. publish: sends the event of a stop; must not block."""

    def __init__(
        self,
        file: Path,
        sessions: Callable[[], Iterable[Session]],
        is_paused: Callable[[], bool],
        call: Callable[[str, str, int], StopAnswer],
        publish: Callable[[Sequence[str], str], None] = lambda robots, reason: None,
    ) -> None:
        self._file, self._sessions, self._is_paused, self._call, self._publish = (
            file,
            sessions,
            is_paused,
            call,
            publish,
        )
        self._lock = threading.Lock()
        self._names: dict[str, _Name] = {}
        # A robot whose call fails is not confirmed, and is called again by the next stop.
        self._callers = Workers("emergency-stops", CALLERS, lambda reason: None)
        #: Held while the file is written, which is apart from the lock: stops don't wait for a disk.
        self._writing = threading.Lock()
        self._written: object = None
        self._is_failing = self._is_closed = False
        self._writer = Repeating("stops file", self._write, lambda: RETRY_S if self._is_failing else math.inf)

    def start(self) -> None:
        """Hold again what was held when the former server process ended."""
        records = read_records(self._file)
        with self._lock:
            for name, record in records.items():
                reasons = record.reasons or ({record.held: 1} if record.held else {})  # of the first release
                known = _Name(StopLatch(max(record.number, *reasons.values(), 0), reasons))
                known.registration, known.target = record.registration, record.target
                known.stands_with_body = record.stands_with_body
                self._names[name] = known
        for session in self._sessions():
            self.admit(session)
        with self._lock:
            present = {session.name for session in self._sessions()}
            self._names = {name: known for name, known in self._names.items() if known.latch.is_on or name in present}
        self._writer.start()

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
        self._writer.wake()

    def report_target(self, session: Session, target: str, stands_with_body: bool) -> None:
        """Set the URI at which a robot is stopped itself."""
        with self._lock:
            known = self._of(session)
            known.target, known.stands_with_body = target, stands_with_body
            known.called, known.is_confirmed = 0, False
        self._writer.wake()

    def forget(self, session: Session) -> None:
        """A session has ended; stops of its name go on."""
        with self._lock:
            known = self._names.get(session.name)
            if known is None or known.registration != registration(session):
                return
            if known.latch.is_on:
                known.registration = known.target = ""
            else:
                del self._names[session.name]
        self._writer.wake()

    # ---- stops ----

    def stop(self, names: Sequence[str], reason: str) -> list[StopState]:
        """Stop robots by name, without names all that are logged on; returns what is known of each at once. A name
        without a robot is held until one logs on, at most MAX_ABSENT of them.

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

    def state(self, session: Session) -> StopState:
        """What is known of a robot."""
        with self._lock:
            known = self._of(session)
            is_held = known.latch.is_on
            is_confirmed = is_held and known.is_confirmed
        ahead, left, turn = session.robot.state().velocity
        speed = math.hypot(ahead, left)
        body_stands = self._is_paused() or (speed < STANDING_SPEED and abs(turn) < STANDING_TURN)
        waits_for = ""
        if not is_held:
            waits_for = "it is not stopped"
        elif not body_stands:
            waits_for = f"it brakes, {speed:.2f} m/s"
        elif not (known.stands_with_body or is_confirmed):
            waits_for = "the actual robot has not confirmed the stop"
        return StopState(session.name, is_held, not waits_for, speed, is_confirmed, waits_for)

    # ---- implementation ----

    def _of(self, session: Session) -> _Name:
        """Requires the lock."""
        known = self._names.get(session.name) or _Name()
        if known.registration != registration(session) and not session.client.is_logged_off:
            known.registration, known.target, known.stands_with_body = registration(session), "", True
            known.called, known.is_confirmed = 0, False
            self._names[session.name] = known
        return known

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
            try:
                answer = self._call(target, reason, number)
            except Exception as error:  # of CORBA, which this module does not know
                _log.warning("%s does not confirm its emergency stop: %s", name, error)
                break
            is_confirmed = answer.is_stopped and answer.is_confirmed
            with self._lock:
                if known.target == target and known.latch.is_on:
                    known.called, known.is_confirmed = number, is_confirmed
        with self._lock:
            known.is_calling = False

    def _write(self) -> None:
        with self._writing:
            with self._lock:
                content = msgspec.json.encode({name: known.record for name, known in self._names.items()})
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
    """The content of the file; empty if there is none or it can't be read."""
    try:
        return decode_json(file.read_bytes(), dict[str, StopRecord])
    except FileNotFoundError:
        return {}
    except (OSError, msgspec.MsgspecError) as error:
        _log.warning("cannot read %s: %s", file, error)
        return {}
