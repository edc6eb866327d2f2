"""Programs that were uploaded to the agent on a robot's computer, and the reports of its runs. They survive a kill -9,
and wait for anybody who asks."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable

import msgspec

from robocorba.errors.robots import IllegalOrder, InvalidProgram
from robocorba.robot.agent import ControlAgent
from robocorba.robot.agent_state import MAX_PAGE, MAX_REPORTS, ProgramReport, ProgramResult, RunReport
from robocorba.robot.programs.fingerprint import Fingerprint, fingerprint
from robocorba.robot.programs.program import Program, loads
from robocorba.system.record_file import RecordFile

#: Why a run has failed whose agent was killed.
INTERRUPTED = "the agent's process ended in this icon"


class _Upload(msgspec.Struct):
    """The program that was uploaded last, in JSON, and the fingerprint of what it was checked against."""

    number: int
    program: str
    checked: str


class Uploads:
    """Thread-safe. A run that a former process has begun and not ended has failed. clock: POSIX time [s].

    All methods raise ServiceError if the file can't be written."""

    def __init__(self, records: RecordFile, clock: Callable[[], float] = time.time) -> None:
        self._records, self._clock = records, clock
        self._lock = threading.Lock()
        self._life = next(iter(records.all("life", str)), "")
        if not self._life:
            self._life = secrets.token_hex(8)
            records.save("life", "", self._life)
        self._upload = next(iter(records.all("upload", _Upload)), None)
        self._program = self._read()
        #: Of the latest runs that have ended, by number.
        self._reports = {report.number: report for report in records.all("report", RunReport)}
        self._running: RunReport | None = None
        for run in records.all("run", RunReport):
            failed = run.program._replace(result=ProgramResult.FAILED, reason=INTERRUPTED)
            self._end(run._replace(program=failed))

    @property
    def program(self) -> Program | None:
        """The program that was uploaded last; None without one, or if this release can't read it."""
        return self._program

    def keep(self, program: str, checked: str) -> int:
        """Keep a program, in JSON, in place of the former one; returns the number of the upload."""
        with self._lock:
            upload = _Upload(self._upload.number + 1 if self._upload else 1, program, checked)
            self._records.save("upload", "", upload)
            self._upload = upload
            self._program = self._read()
            return upload.number

    def note(self, program: Program, report: ProgramReport) -> None:
        """Note what a running program does: it has begun an icon, or has ended."""
        with self._lock:
            run = self._running
            if run is None:
                number = max(self._reports, default=0) + 1
                run = RunReport(
                    number, self._upload.number if self._upload and program == self._program else 0, 0.0, report
                )
            run = self._running = run._replace(program=report)
            if report.result is ProgramResult.NO_RESULT:
                self._records.save("run", "", run)
            else:
                self._running = None
                self._end(run)

    def reports(self, since: str) -> tuple[list[RunReport], str]:
        """Reports after those of an earlier answer, and where the next call begins. since: that of the earlier answer;
        if it is empty or of another file, the reports begin with the first one that is kept."""
        with self._lock:
            life, _, text = since.partition(".")
            number = int(text) if life == self._life and text.isdecimal() and len(text) < 20 else 0
            if number > max(self._reports, default=0):  # the file is older than the asker: it was put back
                number = 0
            found = [report for report in self._reports.values() if report.number > number][:MAX_PAGE]
            return found, f"{self._life}.{found[-1].number if found else number}"

    def _read(self) -> Program | None:
        try:
            return loads(self._upload.program) if self._upload else None
        except InvalidProgram:
            return None

    def _end(self, run: RunReport) -> None:
        """Keep the report of a run, once. If the process is killed in between, the next one does so."""
        if run.number not in self._reports:
            report = run._replace(ended=self._clock())
            self._records.save("report", str(run.number), report)
            self._reports[run.number] = report
        self._records.delete("run", "")
        for old in list(self._reports)[:-MAX_REPORTS]:
            self._records.delete("report", str(old))
            del self._reports[old]


class CheckedPrograms:
    """Programs for an agent, with what they were checked against. building: returns name and version of the map by
    which the agent checks; may raise NotReachable. uploads: None where the agent does not run on the robot's
    computer."""

    def __init__(
        self, agent: ControlAgent, building: Callable[[], tuple[str, int]], uploads: Uploads | None = None
    ) -> None:
        self._agent, self._building, self._uploads = agent, building, uploads

    def fingerprint(self, program: str) -> Fingerprint:
        """What a program, in JSON, is checked against now. Raises InvalidProgram, NotReachable."""
        return fingerprint(loads(program), *self._building())

    def upload(self, program: str, checked: str) -> int:
        """Load and keep a program, in JSON, that was checked against a fingerprint; returns the number of the upload.

        Raises InvalidProgram, FingerprintMismatch, NotReachable, ServiceError; IllegalOrder while a program runs."""
        if self._uploads is None:
            raise IllegalOrder("keep an upload", "has no agent on its own computer: robocorba robot --agent-only there")
        self.fingerprint(program).require(checked)
        self._agent.load(loads(program))
        return self._uploads.keep(program, checked)

    def reports(self, since: str) -> tuple[list[RunReport], str]:
        """As those of the uploads; none without them."""
        return self._uploads.reports(since) if self._uploads else ([], since)
