"""What commands print of events, fleets, paths, processes and missions, and arguments that they hand on."""

from __future__ import annotations

import io
import json
import math
import os
import pathlib
import re
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from typer.testing import CliRunner

from robocorba.commands import command, event_stats
from robocorba.commands.events import json_line, text_line
from robocorba.commands.fleet_view import FleetView, starting_of, table_of
from robocorba.commands.mission import follow_mission
from robocorba.commands.path import parse_place, sheet_of
from robocorba.commands.tables import show
from robocorba.commands.up import sheet_of as sheet_of_system
from robocorba.errors.paths import InvalidRequest
from robocorba.events.corba.event_client import Event
from robocorba.map_editor import native
from robocorba.map_editor.model import Area, ElementKind
from robocorba.map_editor.store import MapStore
from robocorba.planning.request import IndexedNames, Path, Place, PointKind
from robocorba.simulation.mission_record import MissionContent, MissionResult, MissionState, PhaseRecord
from robocorba.stubs import RoboCorba
from robocorba.system.corba.servers import probe_of, servers
from robocorba.system.corba.subnets import default_subnets, parse_subnets, subnets_of_map
from robocorba.system.logs import one_line
from robocorba.system.processes import RobotOrder, RobotProgress
from robocorba.system.settings import InvalidSetting
from robocorba.system.state_folder import ProcessRecord, StateFolder, SystemRecord
from robocorba.system.supervision.fleet import Row, row_of
from robocorba.system.supervision.launch import module_command
from robocorba.system.supervision.process import Supervised
from robocorba.system.supervision.robots import ProgressLines
from testkit.buildings import two_floors, with_all


def event(payload: Any, **more: Any) -> Event:
    return Event("robot.state", "A", payload, 1.5e9, "lab", 7)._replace(**more)


def test_a_line_shows_header_and_payload_of_limited_length() -> None:
    line = text_line(event({"x": 1.5, "floor": "一階"}))
    assert line.startswith(("2017-07-13T", "2017-07-14T"))
    assert line.endswith('  lab:7  robot.state  A  {"x": 1.5, "floor": "一階"}')
    assert text_line(event(1, source="", priority=2, expiry=5.0)).endswith(
        "  robot.state  -  priority 2  expires after 5 s  1"
    )
    header = {"type": "robot.state", "source": "A", "time": 1.5e9, "origin": "lab", "number": 7}
    for payload, shown in (
        (b"\x00\xff", "<2 bytes 00ff>"),
        ({"scan": bytes(1000)}, {"scan": f"<1000 bytes {'00' * 16}…>"}),
        ((1, None, True), [1, None, True]),
        ({1: "a", b"k": "b"}, {"1": "a", "<1 bytes 6b>": "b"}),
        (float("nan"), "nan"),
        (-float("inf"), "-inf"),
    ):
        found = json.loads(json_line(event(payload)))
        assert found == {**header, "payload": shown, "priority": 0, "expiry": 0.0}
    assert "XY" in json.loads(json_line(event(RoboCorba.XY(1.0, 2.0))))["payload"]  # of a plain client
    deep: Any = 0
    for _ in range(900):
        deep = [deep]
    assert len(text_line(event(deep))) < 500
    long = text_line(event("a" * 5000))
    assert len(long) < 500 and long.endswith("… (5002 characters)")


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text() | st.integers() | st.binary(), inner),
)


@settings(max_examples=40)
@given(payload=VALUES, words=st.text(), moment=st.floats())
def test_any_event_is_one_line(payload: Any, words: str, moment: float) -> None:
    one = event(payload, type=words, source=words, time=moment)
    assert text_line(one) == one_line(text_line(one))
    assert len(json_line(one).splitlines()) == 1
    assert json.loads(json_line(one))["source"] == words


def account(received: int, queued: int) -> Any:
    return RoboCorba.Account(received, received - queued, 0, 0, 0, queued)


def state() -> Any:
    pattern, policy = RoboCorba.EventPattern, RoboCorba.QueuePolicy(10, RoboCorba.DISCARD_OLDEST, 0.0)
    one = RoboCorba.Clause([pattern("robot.*", "A")], 0.0)
    two = RoboCorba.Clause([pattern("a", "*"), pattern("b", "B")], 2.5)
    proxies = [
        RoboCorba.ProxyState(name, kind, condition, client, address, wanted, policy, failures, account(*events))
        for name, kind, condition, client, address, wanted, failures, events in (
            ("1", RoboCorba.PUSH_CONSUMER, RoboCorba.CONNECTED, "[/]", "", [], 0, (5, 0)),
            ("2", RoboCorba.PUSH_SUPPLIER, RoboCorba.STALLED, "log", "h:1", [one, two], 3, (5, 2)),
            ("3", RoboCorba.PULL_SUPPLIER, RoboCorba.WAITING, "", "", [one], 0, (4, 4)),
        )
    ]
    links = [
        RoboCorba.LinkState("hall", way, condition, problem, 1, 0.0125, 2, 300, 4, 5, [], account(6, 0))
        for way, condition, problem in (
            (RoboCorba.INCOMING, RoboCorba.UP, ""),
            (RoboCorba.OUTGOING, RoboCorba.DOWN, "away"),
        )
    ]
    return RoboCorba.ChannelState("lab", 99, proxies, links, 1, ["hall", "lab"])


def test_without_a_terminal_a_row_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    show(*event_stats.sheets({"lab": state(), "hall": "does not answer"}))
    sums = ["received", "delivered", "unconfirmed", "discarded", "expired", "queued"]
    assert [line.split("\t") for line in capsys.readouterr().out.splitlines()] == [
        ["channel", "federation", "disconnected after failures", "problem"],
        ["lab", "hall, lab", "1", ""],
        ["hall", "", "", "does not answer"],
        [""],
        ["channel", "proxy", "name", "client", "condition", "subscribed to", *sums],
        ["lab", "push consumer", "[/]", "", "connected", "", "5", "5", "0", "0", "0", "0"],
        [
            *("lab", "push supplier", "log", "h:1", "stalled (3 failures)"),
            *("robot.* from A or (a and b from B within 2.5 s)", "5", "3", "0", "0", "0", "2"),
        ],
        ["lab", "pull supplier", "", "", "waiting", "robot.* from A", "4", "0", "0", "0", "0", "4"],
        [""],
        ["channel", "link", "condition", "problem", "lag", "packets", "bytes", "repeated", "unseen", *sums],
        ["lab", "from hall", "up", "", "12.5 ms", "2", "300", "4", "5", "6", "6", "0", "0", "0", "0"],
        ["lab", "to hall", "down", "away", "12.5 ms", "2", "300", "4", "5", "6", "6", "0", "0", "0", "0"],
    ]


def test_in_a_terminal_it_is_tables(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """As wide as it, without the columns that it names if it is narrow; short cells are whole."""
    for width in ("80", "250"):
        # What rich takes for a terminal; others are 80 columns wide whatever COLUMNS says.
        for name, value in (("FORCE_COLOR", "1"), ("TERM", "xterm"), ("COLUMNS", width), ("NO_COLOR", "1")):
            monkeypatch.setenv(name, value)
        show(*event_stats.sheets({"lab": state(), "hall": "does not answer"}))
        shown = re.sub(r"\x1b\[\d*m", "", capsys.readouterr().out)
        assert max(map(len, shown.splitlines())) <= int(width)
        assert all(word in shown for word in ("supplier", "from hall", "away", "does not answer", "stalled", "queued"))
        assert ("wider terminals and --json also show:" in shown) == (width != "250")


def test_json_has_the_names_of_the_idl() -> None:
    found = json.loads(json.dumps(event_stats.as_json(state())))
    assert found["last_number"] == 99
    assert found["proxies"][1]["kind"] == "PUSH_SUPPLIER"
    assert found["proxies"][1]["subscribed"][1]["patterns"][1] == {"type": "b", "source": "B"}
    assert found["links"][1]["events"]["received"] == 6
    assert event_stats.as_json("away") == {"problem": "away"}


def test_channels_have_all_others_as_peers() -> None:
    editor, simulation, *others = servers(parse_subnets("lab, hall,yard"), sensors=2)
    sensors, channels = others[:2], others[2:]
    assert (editor.name, simulation.arguments) == ("map_editor", ("--channel", "lab"))
    assert [(server.name, list(server.objects), server.arguments) for server in sensors] == [
        ("sensor_s1", ["VirtualSensors/s1"], ("--name", "s1")),
        ("sensor_s2", ["VirtualSensors/s2"], ("--name", "s2")),
    ]
    assert [(server.name, list(server.objects), server.arguments) for server in channels] == [
        ("events_lab", ["EventChannels/lab"], ("--name", "lab", "--peer", "hall", "--peer", "yard")),
        ("events_hall", ["EventChannels/hall"], ("--name", "hall", "--peer", "lab", "--peer", "yard")),
        ("events_yard", ["EventChannels/yard"], ("--name", "yard", "--peer", "lab", "--peer", "hall")),
    ]
    assert all(probe_of(name) for server in (editor, simulation, *others) for name in server.objects)
    assert probe_of("Echo") is None
    for text, reason in (
        *(("", "''"), ("lab,", "''"), ("lab,ha ll", "'ha ll'"), ("../x", "'../x'"), ("-lab", "'-lab'")),
        ("a" * 61, "1 to 60 letters"),
        ("lab,hall,lab", "lab is listed twice"),
        (",".join(f"n{number}" for number in range(300)), "300 channels"),
    ):
        with pytest.raises(InvalidSetting) as refused:
            parse_subnets(text)
        assert refused.value.setting == "--subnets"
        assert reason in refused.value.reason


def test_channels_default_to_the_sub_networks_of_the_map(tmp_path: pathlib.Path) -> None:
    folder, file = StateFolder(tmp_path), tmp_path / "map.yaml"
    room = Area("room", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), "hall")
    rooms = [msgspec.structs.replace(room, name=name, subnet=name) for name in ("lab", "two words")]
    native.save(with_all(two_floors().without(ElementKind.AREA, "L1", "room"), [("L1", room), ("L2", rooms[0])]), file)
    assert default_subnets(folder, None) == ("main",)
    assert default_subnets(folder, file) == ("hall", "lab")
    MapStore.create(tmp_path / "map.sqlite", native.load(file).with_element("L2", rooms[1])).close()
    assert subnets_of_map(folder, None) == ("hall", "lab", "two words")
    assert default_subnets(folder, None) == ("hall", "lab")
    file.write_text("subnet: [")
    assert default_subnets(folder, file) == ("main",)


IDLE = Row("R1", "L1", "waiting", "", 0, "")
RUNNING = Row("R2", "L1", "working", "drive", 0, "")
DEAD = Row("R3", "L2", "ended", "", 1, "ended by SIGKILL")


def printed(rows: list[Row]) -> str:
    console = Console(file=io.StringIO(), width=120)
    console.print(starting_of(rows))
    console.print(table_of(rows))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_what_needs_attention_comes_first() -> None:
    text = printed([IDLE, RUNNING, DEAD])
    assert text.startswith("3 robots: 1 ended, 1 waiting, 1 working\n")
    assert text.index("R3") < text.index("R2") < text.index("R1")
    assert "ended by SIGKILL" in text and "drive" in text
    assert printed([IDLE, IDLE._replace(name="R4", doing="starting")]).startswith("1 of 2 robots have started")
    evil = printed([Row("R1", "[red]", "working", "[bold]x[/bold]", 0, "a\nb\x1b[31m\u202e")])
    assert "[bold]x[/bold]" in evil and "[red]" in evil and "a\\nb\\x1b[31m" in evil


def test_without_a_terminal_each_change_is_a_line_in_one_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    with FleetView(Console(file=io.StringIO())) as view:
        view.show([IDLE, RUNNING])
        view.show([IDLE, RUNNING])
        view.show([IDLE, RUNNING._replace(doing="ended", task="", note="x\ty")])
        view.started()
        view.end(2, 1)
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:] == ["R1\tL1\twaiting\t\t0\t", "R2\tL1\tworking\tdrive\t0\t", "R2\tL1\tended\t\t0\tx\\ty", "ready"]
    console = Console(file=io.StringIO(), force_terminal=True, width=120, height=40)
    with FleetView(console) as view:
        view.show([IDLE, DEAD])
        view.started()
        view.end(1, 1)
        view.end(1, 0)
    assert isinstance(console.file, io.StringIO)
    last = console.file.getvalue().rpartition("all robots have ended")[2]
    assert "R3" in last and "R1" not in last


def test_rows_and_progress_of_a_robot() -> None:
    order, process = RobotOrder("A", floor="L1"), Supervised(None, None, state="running")  # type: ignore[arg-type]
    lines = ProgressLines("robot_A", lambda: None)
    for progress, shown in (
        (RobotProgress(), ("waiting", "", "")),
        (RobotProgress("working", "lumbar (fetch)", "fetch"), ("working", "fetch", "lumbar (fetch)")),
        (RobotProgress("waiting", "waiting for B", "fetch", "done"), ("waiting", "fetch", "waiting for B; done")),
    ):
        lines(progress.line())
        row = row_of(order, process, lines, "")
        assert (row.doing, row.task, row.note) == shown
        assert (row.name, row.floor) == ("A", "L1")
    lines("ready")  # started again
    assert row_of(RobotOrder("A"), process, lines, "L2")[1:4] == ("L2", "waiting", "")
    process.state = "waiting"
    assert row_of(order, process, lines, "").doing == "queued"
    process.state, process.problem = "ended", "robot_A ended with exit code 1"
    ended = row_of(RobotOrder("A"), process, ProgressLines("robot_A", lambda: None), "")
    assert ended == Row("A", "", "ended", "", 0, "ended with exit code 1")
    changes: list[int] = []
    lines = ProgressLines("robot_A", lambda: changes.append(1))
    long = RobotProgress("working", "\u202e" * 100_000, "x\n" * 100_000)
    assert "\n" not in long.line() and len(long.line()) < 10_000
    lines(long.line())
    lines("progress nonsense")  # goes to the log
    assert lines.progress.task == ("x\n" * 100_000)[:1000] and changes == [1]


def test_paths_and_places() -> None:
    names = IndexedNames(["L[1]", ""], ["[/]", "[red]x", ""], ["E [bold]", ""])
    rows = [
        [PointKind.START.value, 0, 0, 1.0, 2.0, math.pi / 2, 0.0, 0.0, -1],
        [PointKind.ELEVATOR_ENTRY.value, 1, 0, 1.0, 5.25, 0.0, 3.25, 3.25, 0],
    ]
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(sheet_of(Path([list(map(float, row)) for row in rows], names, 7)))
    text = console.export_text()
    for word in (
        *("x [m]", "y [m]", "heading [°]", "distance [m]", "time [s]", "3.25 m, 3.2 s, 2 points (map version 7)"),
        *("[/]", "[red]x", "L[1]", "elevator entry E [bold]", "90", "5.25"),
    ):
        assert word in text, text
    for text, place in (
        ("L1:3,4", Place("L1", 3.0, 4.0)),
        ("a:b:-1.5,2e1", Place("a:b", -1.5, 20.0)),
        (" 一階 :0,0", Place(" 一階 ", 0.0, 0.0)),
    ):
        assert parse_place(text, "start") == place
    for text in ("", "L1", "L1:3", ":3,4", "L1:3,4,5", "L1:a,b", "L1:3,", "3,4"):
        with pytest.raises(InvalidRequest) as refused:
            parse_place(text, "goal")
        assert refused.value.field == "goal"


def test_addresses_are_whole_in_any_terminal() -> None:
    names = ("RoboCorba/MapEditor", "RoboCorba/PathPlanner")
    editor = ProcessRecord("map_editor", "running", 123456, "", names, 0.0, 0)
    for width in (60, 80, 200):
        console = Console(width=width, record=True, file=io.StringIO())
        console.print(sheet_of_system(SystemRecord("192.168.100.200:28090", 1, 0.0, (editor,))))
        rows = [line.split("│")[-2].strip() for line in console.export_text().splitlines() if line.startswith("│")]
        assert "".join(rows) == "".join(f"corbaname::192.168.100.200:28090#{name}" for name in names)


def test_how_long_a_mission_takes_does_not_depend_on_the_clock_of_its_leader() -> None:
    for began in (100.0, 4e9):
        asking = MissionContent(kind="move_table", about="desk", leader="A", begun=began)
        gathering = msgspec.structs.replace(asking, phases=(PhaseRecord("gathering", began + 1000.0),))
        contents = iter((asking, gathering, gathering.ended_as(MissionResult.DONE, "", began + 2000.0)))
        control: Any = SimpleNamespace(mission=lambda name, left=contents: MissionState(name, 1, next(left)))
        first, second, last = (status.seconds for status in follow_mission(control, "m", lambda seconds: None))
        assert 0.0 <= first < 500.0
        assert 1000.0 <= second < 1500.0
        assert last == 2000.0


def test_arguments_of_the_adaptor_stay_apart_and_those_that_exclude_each_other_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given: list[tuple[str, ...]] = []
    monkeypatch.setattr(os, "execv", lambda program, words: given.append(words))
    adaptor = ["--", "--naming", "robot:2", "--pose=1,2,3"]
    for arguments, handed_on in (
        (["A", "--floor", "L1", "--at", "-1,2"], ["A", "--floor=L1", "--at=-1,2"]),
        (
            ["A", "--adaptor", "smartpal", "--naming", "h:1", *adaptor],
            ["A", "--adaptor=smartpal", "--naming=h:1", *adaptor],
        ),
        (["--progress", "--protect", "on", "A", *adaptor], ["A", "--progress", "--protect=on", *adaptor]),
    ):
        assert CliRunner().invoke(command(["robot"]), ["robot", *arguments]).exit_code == 0
        assert given.pop() == module_command("robocorba.clients.robot", *handed_on)
    for wrong in (["A", "--nonsense"], [], ["--help"]):
        assert CliRunner().invoke(command(["robot"]), ["robot", *wrong]).exit_code == (0 if "--help" in wrong else 2)
    assert not given
    for arguments in ([], ["--count", "2", "f.yaml"], ["f.yaml", "--floor", "L1"], ["--count", "-1"]):
        assert CliRunner().invoke(command(["robots"]), ["robots", *arguments]).exit_code == 2
