"""Emergency stops at the simulation server: it holds the robots' bodies, and calls the robots themselves.

What must outlive the server's process is in a file: for each robot the reference of its stop target, and why it is
held. With that file an operator can stop the robots, too, while the server does not answer."""

from __future__ import annotations

import hashlib
import logging
import math
import os
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypedDict

import msgspec

from robocorba.decoding import decode_json
from robocorba.errors.simulation import UnknownRobot
from robocorba.repeating import Repeating

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

_log = logging.getLogger(__name__)


class StopAnswer(NamedTuple):
    """What a robot says of its own stop. is_confirmed: its adaptor has confirmed it."""

    is_stopped: bool
    is_confirmed: bool
    reason: str = ""


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
    """A robot in the file. registration: identifies its session. target: URI, empty if it has reported none.

    stands_with_body: the robot is its body in the building. held: why it is held, empty if it is not."""

    registration: str
    target: str = ""
    stands_with_body: bool = True
    held: str = ""


class EmergencyStops:
    """Thread-safe. sessions: the current ones. is_paused: whether simulated time stands still.

    call: stops a robot at the URI of its stop target, and returns its answer; raises any exception if it does not
    answer. publish: sends the event of a stop; must not block."""

    def __init__(
        self,
        file: Path,
        sessions: Callable[[], Iterable[Session]],
        is_paused: Callable[[], bool],
        call: Callable[[str, str], StopAnswer],
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
        self._records: dict[str, StopRecord] = {}
        #: Robots whose target is being called, and those whose target has confirmed the present stop.
        self._calling: set[str] = set()
        self._confirmed: set[str] = set()
        self._callers = ThreadPoolExecutor(CALLERS, "emergency-stops")
        self._written: object = None
        self._is_failing = self._is_closed = False
        self._writer = Repeating("stops file", self._write, lambda: RETRY_S if self._is_failing else math.inf)

    def start(self) -> None:
        """Hold again the robots that were held when the former server process ended."""
        for name, record in read_records(self._file).items():
            session = self._session(name)
            if session is not None and registration(session) == record.registration:
                self._records[name] = record
                if record.held:
                    session.robot.emergency_stop(record.held)
        self._writer.start()

    def close(self) -> None:
        """Write the last stops; robots are stopped afterwards too, but no more targets are called."""
        with self._lock:
            self._is_closed = True
        self._callers.shutdown(wait=False, cancel_futures=True)
        self._writer.close()
        self._write()

    def report_target(self, session: Session, target: str, stands_with_body: bool) -> None:
        """Set the URI at which a robot is stopped itself."""
        with self._lock:
            record = self._record(session)
            record.target, record.stands_with_body = target, stands_with_body
            self._confirmed.discard(session.name)
        self._writer.wake()

    def stop(self, names: Sequence[str], reason: str) -> list[StopState]:
        """Stop robots by name, without names all; returns immediately what is known of each. Call it again until all
        stand: targets that have not confirmed are called again."""
        reason = reason[:MAX_REASON] or "emergency stop"
        wanted = set(names)
        stopped = [session for session in self._sessions() if not wanted or session.name in wanted]
        new = [session for session in stopped if not session.robot.stop_reason]
        for session in stopped:
            session.robot.emergency_stop(reason)
        if new:
            _log.warning("emergency stop of %s: %s", ", ".join(session.name for session in new), reason)
            self._publish([session.name for session in new] if wanted else (), reason)
        with self._lock:
            for session in stopped:
                record = self._record(session)
                record.held = session.robot.stop_reason
                is_called = session.name in self._confirmed | self._calling or self._is_closed
                if record.target and not is_called:
                    self._calling.add(session.name)
                    self._callers.submit(self._call_target, session.name, record.target, record.held)
        self._writer.wake()
        return [self.state(session) for session in stopped]

    def state(self, session: Session) -> StopState:
        """What is known of a robot."""
        with self._lock:
            record = self._records.get(session.name) or StopRecord(registration(session))
            is_confirmed = session.name in self._confirmed
        ahead, left, turn = session.robot.state().velocity
        speed = math.hypot(ahead, left)
        body_stands = self._is_paused() or (speed < STANDING_SPEED and abs(turn) < STANDING_TURN)
        is_held = bool(session.robot.stop_reason)
        waits_for = ""
        if not is_held:
            waits_for = "it is not stopped"
        elif not body_stands:
            waits_for = f"it brakes, {speed:.2f} m/s"
        elif not (record.stands_with_body or is_confirmed):
            waits_for = "the actual robot has not confirmed the stop"
        return StopState(session.name, is_held, not waits_for, speed, is_confirmed, waits_for)

    def reset(self, session: Session) -> None:
        """Let a robot move again."""
        with self._lock:
            session.robot.reset_stop()
            self._record(session).held = ""
            self._confirmed.discard(session.name)
        self._writer.wake()

    def reset_robot(self, name: str) -> None:
        """Let a robot move again. Raises UnknownRobot."""
        session = self._session(name)
        if session is None:
            raise UnknownRobot(name)
        self.reset(session)

    def forget(self, session: Session) -> None:
        """A session has ended."""
        with self._lock:
            self._records.pop(session.name, None)
            self._confirmed.discard(session.name)
        self._writer.wake()

    def _session(self, name: str) -> Session | None:
        return next((session for session in self._sessions() if session.name == name), None)

    def _record(self, session: Session) -> StopRecord:
        record = self._records.get(session.name)
        if record is None or record.registration != registration(session):
            record = self._records[session.name] = StopRecord(registration(session))
            self._confirmed.discard(session.name)
        return record

    def _call_target(self, name: str, target: str, reason: str) -> None:
        is_confirmed = False
        try:
            answer = self._call(target, reason)
            is_confirmed = answer.is_stopped and answer.is_confirmed
        except Exception as error:  # of CORBA, which this module does not know
            _log.warning("%s does not confirm its emergency stop: %s", name, error)
        finally:
            with self._lock:
                self._calling.discard(name)
        with self._lock:
            record = self._records.get(name)
            if is_confirmed and record is not None and record.target == target and record.held:
                self._confirmed.add(name)

    def _write(self) -> None:
        with self._lock:
            content = msgspec.json.encode(self._records)
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
