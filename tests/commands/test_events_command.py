"""What `robocorba events` prints of any event and of any state."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.commands import event_stats
from robocorba.commands.events import json_line, text_line
from robocorba.corba.event_client import Event
from robocorba.settings import InvalidSetting
from robocorba.stubs import RoboCorba
from robocorba.supervision.servers import probe_of, servers
from robocorba.supervision.subnets import parse_subnets


def event(payload: Any, **more: Any) -> Event:
    return Event("robot.state", "A", payload, 1.5e9, "lab", 7)._replace(**more)


def test_a_line_shows_header_and_payload() -> None:
    line = text_line(event({"x": 1.5, "floor": "一階"}))
    assert line.startswith(("2017-07-13T", "2017-07-14T"))
    assert line.endswith('  lab:7  robot.state  A  {"x": 1.5, "floor": "一階"}')
    assert text_line(event(1, source="", priority=2, expiry=5.0)).endswith(
        "  robot.state  -  priority 2  expires after 5 s  1"
    )


@pytest.mark.parametrize(
    ("payload", "shown"),
    [
        (b"\x00\xff", "<2 bytes 00ff>"),
        ({"scan": bytes(1000)}, {"scan": f"<1000 bytes {'00' * 16}…>"}),
        ((1, None, True), [1, None, True]),
        ({1: "a", b"k": "b"}, {"1": "a", "<1 bytes 6b>": "b"}),
        (float("nan"), "nan"),
        (-float("inf"), "-inf"),
    ],
)
def test_values_without_a_json_type_are_shown_as_text(payload: Any, shown: Any) -> None:
    found = json.loads(json_line(event(payload)))
    assert found == {
        "type": "robot.state",
        "source": "A",
        "payload": shown,
        "time": 1.5e9,
        "origin": "lab",
        "number": 7,
        "priority": 0,
        "expiry": 0.0,
    }


def test_a_struct_of_a_plain_client_is_shown() -> None:
    assert "XY" in json.loads(json_line(event(RoboCorba.XY(1.0, 2.0))))["payload"]


def test_nesting_and_length_are_limited() -> None:
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
    assert text_line(one).isprintable()
    assert len(json_line(one).splitlines()) == 1
    assert json.loads(json_line(one))["source"] == words


def account(received: int, queued: int) -> Any:
    return RoboCorba.Account(received, received - queued, 0, 0, 0, queued)


def state() -> Any:
    pattern = RoboCorba.EventPattern
    wanted = [
        RoboCorba.Clause([pattern("robot.*", "A")], 0.0),
        RoboCorba.Clause([pattern("a", "*"), pattern("b", "B")], 2.5),
    ]
    policy = RoboCorba.QueuePolicy(10, RoboCorba.DISCARD_OLDEST, 0.0)
    proxies = [
        RoboCorba.ProxyState(
            "1", RoboCorba.PUSH_CONSUMER, RoboCorba.CONNECTED, "[/]", "", [], policy, 0, account(5, 0)
        ),
        RoboCorba.ProxyState(
            "2", RoboCorba.PUSH_SUPPLIER, RoboCorba.STALLED, "log", "h:1", wanted, policy, 3, account(5, 2)
        ),
        RoboCorba.ProxyState(
            "3", RoboCorba.PULL_SUPPLIER, RoboCorba.WAITING, "", "", wanted[:1], policy, 0, account(4, 4)
        ),
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
    event_stats.show({"lab": state(), "hall": "does not answer"})
    assert [line.split("\t") for line in capsys.readouterr().out.splitlines()] == [
        ["lab", "proxy", "push consumer", "[/]", "", "connected", "", "5", "5", "0", "0", "0", "0"],
        [
            *("lab", "proxy", "push supplier", "log", "h:1", "stalled (3 failures)"),
            *("robot.* from A or (a and b from B within 2.5 s)", "5", "3", "0", "0", "0", "2"),
        ],
        ["lab", "proxy", "pull supplier", "", "", "waiting", "robot.* from A", "4", "0", "0", "0", "0", "4"],
        ["lab", "link", "from hall", "up", "12.5 ms", "2", "300", "4", "5", "6", "6", "0", "0", "0", "0"],
        ["lab", "link", "to hall", "down (away)", "12.5 ms", "2", "300", "4", "5", "6", "6", "0", "0", "0", "0"],
        ["lab", "total", "suppliers", "5", "5", "0", "0", "0", "0"],
        ["lab", "total", "consumers", "9", "3", "0", "0", "0", "6"],
        ["lab", "total", "links in", "6", "6", "0", "0", "0", "0"],
        ["lab", "total", "links out", "6", "6", "0", "0", "0", "0"],
        ["hall", "problem", "does not answer"],
    ]


def test_in_a_terminal_it_is_tables(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # what rich takes for a terminal
    monkeypatch.setenv("TERM", "xterm")  # others are 80 columns wide whatever COLUMNS says
    monkeypatch.setenv("COLUMNS", "200")
    event_stats.show({"lab": state(), "hall": "does not answer"})
    shown = capsys.readouterr().out
    for word in (
        "unconfirmed",
        "[/]",
        "stalled (3 failures)",
        "from hall",
        "12.5 ms",
        "to hall: away",
        "does not answer",
    ):
        assert word in shown, shown


def test_json_has_the_names_of_the_idl() -> None:
    found = json.loads(json.dumps(event_stats.as_json(state())))
    assert found["lastNumber"] == 99
    assert found["proxies"][1]["kind"] == "PUSH_SUPPLIER"
    assert found["proxies"][1]["subscribed"][1]["patterns"][1] == {"type": "b", "source": "B"}
    assert found["links"][1]["events"]["received"] == 6
    assert event_stats.as_json("away") == {"problem": "away"}


def test_each_channel_has_all_others_as_peers() -> None:
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


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "''"),
        ("lab,", "''"),
        ("lab,ha ll", "'ha ll'"),
        ("../x", "'../x'"),
        ("-lab", "'-lab'"),
        ("a" * 61, "1 to 60 letters"),
        ("lab,hall,lab", "lab is listed twice"),
        (",".join(f"n{number}" for number in range(300)), "300 channels"),
    ],
)
def test_an_invalid_list_of_subnets_is_refused(text: str, reason: str) -> None:
    with pytest.raises(InvalidSetting) as refused:
        parse_subnets(text)
    assert refused.value.setting == "--subnets"
    assert reason in refused.value.reason
