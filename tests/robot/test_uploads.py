"""Uploaded programs and reports of their runs: nothing is lost, and nothing comes twice, whatever ends in between."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from robocorba.errors.robots import FingerprintMismatch, IllegalOrder, InvalidProgram
from robocorba.robot.agent_state import ProgramReport, ProgramResult, RunReport
from robocorba.robot.programs.fingerprint import fingerprint
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.local_checks import check_without_servers
from robocorba.robot.programs.program import Program, dumps, loads
from robocorba.robot.uploads import INTERRUPTED, MAX_PAGE, MAX_REPORTS, CheckedPrograms, Uploads
from robocorba.system.record_file import RecordFile
from robocorba.system.settings import InvalidSetting, RobotSettings

PROGRAMS = [ProgramBuilder(name).wait(1).wait(2).wait(3).program() for name in ("one", "two")]
IDENTITY = 0x526F4372
#: After how many writes the process is killed; mostly it is not.
writes = st.sampled_from([1000, 1000, 0, 1, 2, 3, 4])


class Killed(Exception):
    """The process has ended."""


class Records(RecordFile):
    """A file whose process is killed before its last write is done, after a number of them."""

    left = 1000

    def save(self, kind: str, key: str, record: object) -> None:
        self._spend()
        super().save(kind, key, record)

    def delete(self, kind: str, key: str) -> None:
        self._spend()
        super().delete(kind, key)

    def _spend(self) -> None:
        if not self.left:
            raise Killed
        self.left -= 1


class Agent:
    """An agent that checks and runs what it is told."""

    def __init__(self) -> None:
        self.loaded: Program | None = None
        self.is_running = False

    def load(self, program: Program) -> None:
        if self.is_running:
            raise IllegalOrder("load a program", "runs a program")
        self.loaded = program


class Run(NamedTuple):
    """Of the model."""

    upload: int
    name: str
    icon: str
    result: ProgramResult
    reason: str


class Life(RuleBasedStateMachine):
    """Uploads, runs, kills at any write, and one who asks over a link that is cut and keeps what was answered last."""

    @initialize()
    def begin(self) -> None:
        self.closing = contextlib.ExitStack()
        self.folder = Path(self.closing.enter_context(tempfile.TemporaryDirectory()))
        self.file = self.folder / "0.sqlite"
        self.version, self.lives, self.time = 1, 0, 0.0
        self.kept: tuple[int, Program] | None = None
        self.ended: list[Run] = []
        self.heard: list[RunReport] = []
        self.following = ""
        self.start()

    def start(self) -> None:
        self.records = self.closing.enter_context(Records(self.file, IDENTITY, 1))
        self.uploads, self.agent = Uploads(self.records, lambda: self.time), Agent()
        self.agent.loaded = self.uploads.program
        self.desk = CheckedPrograms(self.agent, lambda: ("tower", self.version), self.uploads)  # type: ignore[arg-type]

    def teardown(self) -> None:
        if hasattr(self, "closing"):
            self.closing.close()

    @rule(program=st.sampled_from(PROGRAMS), is_edited=st.booleans(), left=writes)
    def upload(self, program: Program, is_edited: bool, left: int) -> None:
        checked = str(self.desk.fingerprint(dumps(program)))
        self.version += is_edited
        self.records.left = left
        try:
            number = self.desk.upload(dumps(program), checked)
        except FingerprintMismatch as error:
            assert is_edited and error.part == "map"
        except Killed:
            self.kill()
        else:
            assert not is_edited
            assert number == (self.kept[0] if self.kept else 0) + 1
            self.kept = number, program
        self.records.left = 1000

    @rule(program=st.sampled_from(PROGRAMS))
    def load(self, program: Program) -> None:
        self.agent.load(program)

    @rule(icons=st.integers(1, 3), result=st.sampled_from(["done", "aborted", "rejected upload"]), left=writes)
    def run(self, icons: int, result: str, left: int) -> None:
        """A program runs; an upload meanwhile is rejected. The process may be killed before one of the writes."""
        loaded = self.agent.loaded
        if loaded is None:
            return
        upload = self.kept[0] if self.kept and self.kept[1] == loaded else 0
        wanted = ProgramResult.ABORTED if result == "aborted" else ProgramResult.DONE
        self.agent.is_running, self.records.left = True, left
        try:
            for icon in range(icons):
                self.uploads.note(loaded, ProgramReport(loaded.name, icon=f"icons[{icon}]"))
                if result == "rejected upload":
                    with pytest.raises(IllegalOrder):
                        self.desk.upload(dumps(PROGRAMS[0]), str(self.desk.fingerprint(dumps(PROGRAMS[0]))))
            self.uploads.note(loaded, ProgramReport(loaded.name, wanted, f"icons[{icon}]"))
        except Killed:
            if 0 < left <= icons:  # it was noted that the program runs, and up to which icon
                failed = f"icons[{left - 1}]", ProgramResult.FAILED, INTERRUPTED
                self.ended.append(Run(upload, loaded.name, *failed))
        if left > icons:
            self.ended.append(Run(upload, loaded.name, f"icons[{icons - 1}]", wanted, ""))
        if left <= icons + 1:
            self.kill()
        self.agent.is_running, self.records.left = False, 1000

    @rule()
    def kill(self) -> None:
        """The file as it is, for another process."""
        self.lives += 1
        self.time += 1.0
        for suffix in ("", "-wal"):
            if (former := Path(f"{self.file}{suffix}")).exists():
                shutil.copy(former, self.folder / f"{self.lives}.sqlite{suffix}")
        self.file = self.folder / f"{self.lives}.sqlite"
        self.start()

    @rule(is_answer_lost=st.booleans())
    def ask(self, is_answer_lost: bool) -> None:
        found, following = self.uploads.reports(self.following)
        if not is_answer_lost:
            self.heard += found
            self.following = following

    @invariant()
    def each_run_is_reported_once_and_in_order(self) -> None:
        if not hasattr(self, "uploads"):
            return
        found, following = self.uploads.reports("")
        assert [plain(report) for report in found] == self.ended
        assert [report.number for report in found] == list(range(1, len(found) + 1))
        assert [plain(report) for report in self.heard] == self.ended[: len(self.heard)]
        assert self.uploads.reports(following) == ([], following)
        kept = self.uploads.program
        assert kept == (self.kept[1] if self.kept else None)


def plain(report: RunReport) -> Run:
    program = report.program
    return Run(report.upload, program.name, program.icon, program.result, program.reason)


TestLife = Life.TestCase
TestLife.settings = settings(max_examples=12, stateful_step_count=20, deadline=None)


def test_pages_limits_other_files_and_a_program_of_another_release(tmp_path: Path) -> None:
    done = ProgramReport("one", ProgramResult.DONE)
    with RecordFile(tmp_path / "a.sqlite", IDENTITY, 1) as records:
        uploads = Uploads(records)
        for _ in range(MAX_REPORTS + 5):
            uploads.note(PROGRAMS[0], done)
        found, following = uploads.reports("")
        seen = [report.number for report in found]
        while found:
            assert len(found) <= MAX_PAGE
            found, following = uploads.reports(following)
            seen += [report.number for report in found]
        assert seen == list(range(6, MAX_REPORTS + 6))
        for other in ("", "other.3", "x", f"{following}0", f"{following.partition('.')[0]}.-1", "." * 100):
            assert uploads.reports(other)[0][0].number == 6
    with RecordFile(tmp_path / "a.sqlite", IDENTITY, 1) as records:
        assert Uploads(records).reports(following) == ([], following)
    with RecordFile(tmp_path / "a.sqlite", IDENTITY, 1) as records:
        Uploads(records).keep('{"name": "x", "icons": [{"icon": "fly"}]}', "")
        assert Uploads(records).program is None
        assert Uploads(records).keep(dumps(PROGRAMS[0]), "") == 2


def test_a_fingerprint_names_what_differs() -> None:
    here = fingerprint(PROGRAMS[0], "Haus am See", 3)
    here.require(str(here))
    here.require(str(fingerprint(loads(msgspec.json.encode(PROGRAMS[0])), "Haus am See", 3)))
    for other, part in (
        (str(fingerprint(PROGRAMS[1], "Haus am See", 3)), "program"),
        (str(fingerprint(PROGRAMS[0], "Haus am See", 4)), "map"),
        (str(here._replace(robot="0")), "robot"),
        ("sha256", "fingerprint"),
    ):
        with pytest.raises(FingerprintMismatch) as raised:
            here.require(other)
        assert raised.value.part == part
    assert str(raised.value).endswith("check it again")


@pytest.mark.parametrize(
    ("icon", "parameter", "server"),
    [
        ({"icon": "mbase_path", "floor": "L2", "x": 1, "y": 1}, "floor", "an elevator ride"),
        ({"icon": "gripper", "hand": "left", "action": "close", "object": "T1"}, "object", "knows objects"),
        ({"icon": "wait_until", "condition": {"when": "holding", "hand": "left"}, "seconds": 1}, "condition", "hands"),
        ({"icon": "move_table", "table": "T1", "to": {"floor": "L1", "x": 1, "y": 1}}, "icon", "a mission"),
        ({"icon": "hand_over", "object": "T1", "taker": "B"}, "icon", "a mission"),
        ({"icon": "say", "type": "x"}, "icon", "--channel"),
        ({"icon": "wait_until", "condition": {"when": "event"}, "seconds": 1}, "icon", "--channel"),
    ],
)
def test_what_needs_a_server_is_refused_wherever_it_is(icon: dict[str, Any], parameter: str, server: str) -> None:
    around = {"icon": "repeat", "times": 2, "icons": [{"icon": "wait", "seconds": 1}, icon]}
    program = loads(msgspec.json.encode({"name": "x", "icons": [around]}))
    (finding,) = check_without_servers(program, "L1", has_channel=False).findings
    assert (finding.icon, finding.parameter) == ("icons[0].icons[1]", parameter)
    assert server in finding.reason
    assert check_without_servers(program, "L1", has_channel=True).is_valid == (server == "--channel")


def test_what_a_robot_can_do_by_itself_is_not_refused() -> None:
    icons: list[dict[str, Any]] = [
        {"icon": "mbase_path", "floor": "L1", "x": 1, "y": 1},
        {"icon": "mbase_to", "x": 1, "y": 1},
        {"icon": "mbase_by", "ahead": 1},
        {"icon": "mbase_velocity", "ahead": 0.1, "left": 0, "turn": 0, "seconds": 1},
        {"icon": "mhand_posture", "hand": "both", "posture": "carry"},
        {"icon": "lumbar", "lower": 0, "upper": 0},
        {"icon": "gripper", "hand": "left", "action": "close", "force": 5},
        {"icon": "wait", "seconds": 1},
        {"icon": "wait_until", "condition": {"when": "closer_than", "sensor": "front", "distance": 0.3}, "seconds": 1},
    ]
    inside = {"icon": "stop_if_closer", "sensor": "laser", "distance": 0.3, "icons": icons}
    program = loads(msgspec.json.encode({"name": "x", "icons": [*icons, inside]}))
    assert check_without_servers(program, "L1", has_channel=False).findings == ()


def test_an_agent_elsewhere_keeps_nothing_and_one_alone_refuses_the_perception_that_it_lacks() -> None:
    desk = CheckedPrograms(Agent(), lambda: ("tower", 1))  # type: ignore[arg-type]
    text = dumps(PROGRAMS[0])
    with pytest.raises(IllegalOrder, match="--agent-only"):
        desk.upload(text, str(desk.fingerprint(text)))
    assert desk.reports("1.2") == ([], "1.2")
    with pytest.raises(InvalidProgram):
        desk.fingerprint("{}")
    with pytest.raises(InvalidSetting, match="--perceive"):
        RobotSettings.read(["A", "--agent-only", "--perceive", "sensors"])
    assert RobotSettings.read(["A", "--agent-only"]).is_agent_only
