"""What `robocorba robots` shows of a fleet."""

from __future__ import annotations

import io
from collections.abc import Callable

import pytest
from rich.console import Console
from typer.testing import CliRunner

from robocorba.commands import command
from robocorba.commands.fleet_view import LinesView, TableView, starting_of, table_of, view_for
from robocorba.processes import RobotOrder, RobotProgress
from robocorba.supervision.fleet import Row, row_of
from robocorba.supervision.process import Supervised
from robocorba.supervision.robots import ProgressLines

IDLE = Row("R1", "L1", "idle", "", 0, "")
RUNNING = Row("R2", "L1", "running", "drive", 0, "")
DEAD = Row("R3", "L2", "ended", "", 1, "ended by SIGKILL")


def printed(rows: list[Row]) -> str:
    console = Console(file=io.StringIO(), width=120)
    console.print(starting_of(rows))
    console.print(table_of(rows))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_what_needs_attention_comes_first() -> None:
    text = printed([IDLE, RUNNING, DEAD])
    assert text.startswith("3 robots: 1 ended, 1 idle, 1 running\n")
    assert text.index("R3") < text.index("R2") < text.index("R1")
    assert "ended by SIGKILL" in text and "drive" in text


def test_the_start_has_its_progress() -> None:
    assert printed([IDLE, IDLE._replace(name="R4", doing="starting")]).startswith("1 of 2 robots have started")


def test_names_and_reasons_are_text() -> None:
    evil = Row("R1", "[red]", "running", "[bold]x[/bold]", 0, "a\nb\x1b[31m\u202e")
    text = printed([evil])
    assert "[bold]x[/bold]" in text and "[red]" in text and "a\\nb\\x1b[31m" in text


def test_without_a_terminal_each_change_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    with view_for(Console(file=io.StringIO())) as view:
        assert isinstance(view, LinesView)
        view.show([IDLE, RUNNING])
        view.show([IDLE, RUNNING])
        view.show([IDLE, RUNNING._replace(doing="ended", task="", note="x\ty")])
        view.started()
        view.end(2, 1)
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["R1\tL1\tidle\t\t0\t", "R2\tL1\trunning\tdrive\t0\t", "R2\tL1\tended\t\t0\tx\\ty", "ready"]


def test_the_table_replaces_itself() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=120, height=40)
    with view_for(console) as view:
        assert isinstance(view, TableView)
        view.show([IDLE, DEAD])
        view.started()
        view.end(1, 1)
        view.end(1, 0)
    assert isinstance(console.file, io.StringIO)
    last = console.file.getvalue().rpartition("all robots have ended")[2]
    assert "R3" in last and "R1" not in last


@pytest.mark.parametrize(
    ("progress", "shown"),
    [
        (RobotProgress(), ("idle", "", "")),
        (RobotProgress("running", "drive"), ("running", "drive", "")),
        (RobotProgress("idle", "drive", "done"), ("idle", "drive", "done")),
        (RobotProgress("idle", "drive", "failed", "blocked"), ("idle", "drive", "failed: blocked")),
        (RobotProgress("stopped", "drive", "aborted", "button"), ("stopped", "drive", "button")),
    ],
)
def test_a_row_of_a_robot(spec: Callable[[str], Supervised], progress: RobotProgress, shown: tuple[str, ...]) -> None:
    process, lines = spec("running"), ProgressLines("robot_A", lambda: None)
    lines(progress.line())
    row = row_of(RobotOrder("A", floor="L1"), process, lines, "")
    assert (row.doing, row.task, row.note) == shown
    assert (row.name, row.floor) == ("A", "L1")
    lines("ready")  # started again
    assert row_of(RobotOrder("A"), process, lines, "L2")[1:4] == ("L2", "idle", "")


def test_a_row_of_a_robot_that_ended(spec: Callable[[str], Supervised]) -> None:
    process = spec("ended")
    process.problem = "robot_A ended with exit code 1"
    row = row_of(RobotOrder("A"), process, ProgressLines("robot_A", lambda: None), "")
    assert row == Row("A", "", "ended", "", 0, "ended with exit code 1")


@pytest.fixture
def spec() -> Callable[[str], Supervised]:
    return lambda state: Supervised(None, None, state=state)  # type: ignore[arg-type]


def test_progress_is_a_line_of_bounded_length() -> None:
    changes: list[int] = []
    lines = ProgressLines("robot_A", lambda: changes.append(1))
    long = RobotProgress("running", "x\n" * 100_000, "", "\u202e" * 100_000)
    assert "\n" not in long.line() and len(long.line()) < 10_000
    lines(long.line())
    lines("progress nonsense")  # goes to the log
    assert lines.progress.task == ("x\n" * 100_000)[:1000] and changes == [1]


@pytest.mark.parametrize("arguments", [[], ["--count", "2", "f.yaml"], ["f.yaml", "--floor", "L1"], ["--count", "-1"]])
def test_what_the_command_refuses(arguments: list[str]) -> None:
    assert CliRunner().invoke(command(["robots"]), ["robots", *arguments]).exit_code == 2
