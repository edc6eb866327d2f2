"""Differences between reports become happenings in words."""

from __future__ import annotations

import copy
from typing import Any

from robocorba.console.happenings import KEPT_S, MAX_TEXT, Happenings

PROGRAM = {"name": "", "result": "NO_RESULT", "reason": ""}


def rows() -> dict[str, Any]:
    client = {"name": "R1", "at": {"floor": "L1"}}
    agent = {
        "condition": "IDLE",
        "reason": "",
        "at": {"floor": "L1"},
        "mission": "",
        "program": dict(PROGRAM),
    }
    link = {"peer": "b", "direction": "INCOMING", "condition": "UP"}
    server = {"state": {"collisions": 0, "paused": False}, "clients": [client], "sensors": []}
    return {
        "naming": "",
        "server": {"state": server, "age": 0.1, "problem": ""},
        "robots": {"R1": {"state": agent, "age": 0.1, "problem": "", "bound": True}},
        "channels": {"a": {"state": {"links": [link]}, "age": 0.1, "problem": ""}},
    }


def noticed(*steps: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Kind, robot and text of what a sequence of reports shows."""
    happenings = Happenings()
    for at_s, step in enumerate(steps):
        happenings.note(step, float(at_s))
    return [(each.kind, each.robot, each.text) for each in happenings.after(0)]


def changed(before: dict[str, Any], *path: str, to: Any) -> dict[str, Any]:
    """A copy of reports with one value changed."""
    after = copy.deepcopy(before)
    entry = after
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] = to
    return after


def test_the_first_report_and_an_equal_one_are_no_news() -> None:
    assert noticed(rows(), rows()) == []


def test_collisions_are_counted() -> None:
    one = changed(rows(), "server", "state", "state", "collisions", to=1)
    three = changed(rows(), "server", "state", "state", "collisions", to=3)
    assert noticed(rows(), one, three) == [("collision", "", "a collision"), ("collision", "", "2 collisions")]


def test_a_counter_of_a_restarted_server_is_no_collision() -> None:
    assert noticed(changed(rows(), "server", "state", "state", "collisions", to=7), rows()) == []


def test_stop_and_release_with_the_reason() -> None:
    stopped = changed(rows(), "robots", "R1", "state", "condition", to="STOPPED")
    stopped["robots"]["R1"]["state"]["reason"] = "emergency stop"
    assert noticed(rows(), stopped, rows()) == [
        ("stop", "R1", "R1 is stopped: emergency stop"),
        ("stop", "R1", "R1 may move again"),
    ]


def test_a_program_begins_and_fails() -> None:
    running = changed(rows(), "robots", "R1", "state", "condition", to="RUNNING")
    running["robots"]["R1"]["state"]["program"] = {**PROGRAM, "name": "fetch"}
    failed = changed(
        rows(), "robots", "R1", "state", "program", to={"name": "fetch", "result": "FAILED", "reason": "door"}
    )
    assert noticed(rows(), running, failed) == [
        ("program", "R1", "R1 runs fetch"),
        ("program", "R1", "R1 has ended fetch, failed: door"),
    ]


def test_a_mission_is_taken_up_and_left() -> None:
    taking_part = changed(rows(), "robots", "R1", "state", "mission", to="M1")
    assert noticed(rows(), taking_part, rows()) == [
        ("mission", "R1", "R1 takes part in mission M1"),
        ("mission", "R1", "R1 leaves mission M1"),
    ]


def test_robots_log_off_and_fall_silent() -> None:
    off = changed(rows(), "server", "state", "clients", to=[])
    silent = changed(off, "robots", "R1", "age", to=4.0)
    assert noticed(rows(), off, silent) == [("robot", "R1", "R1 has logged off"), ("robot", "R1", "R1 does not answer")]


def test_a_robot_that_ends_takes_its_name_from_the_naming_service() -> None:
    ended = changed(rows(), "robots", "R1", "age", to=4.0)
    ended["robots"]["R1"]["bound"] = False
    assert noticed(rows(), ended) == [("robot", "R1", "R1 has ended")]


def test_a_lost_server_is_no_crowd_of_leaving_robots() -> None:
    lost = changed(rows(), "server", "problem", to="does not answer")
    assert [kind for kind, _, _ in noticed(rows(), lost, rows())] == ["server", "server"]


def test_a_gateway_goes_down() -> None:
    link = {"peer": "b", "direction": "INCOMING", "condition": "DOWN"}
    down = changed(rows(), "channels", "a", "state", "links", to=[link])
    assert noticed(rows(), down) == [("channel", "", "the gateway from b to a is down")]


def test_a_new_robot_is_said_once() -> None:
    asked = changed(rows(), "robots", "R2", to={"state": None, "age": None, "problem": "", "bound": True})
    answers = changed(rows(), "robots", "R2", to=rows()["robots"]["R1"])
    assert noticed(rows(), asked, answers) == [("robot", "R2", "R2 has started")]


def test_a_new_robot_that_hangs_is_said() -> None:
    asked = changed(rows(), "robots", "R2", to={"state": None, "age": None, "problem": "", "bound": True})
    hangs = changed(asked, "robots", "R2", "problem", to="does not answer")
    assert [text for _, _, text in noticed(rows(), asked, hangs)] == ["R2 has started", "R2 does not answer"]


def test_the_first_robot_and_channel_of_a_running_system_are_said() -> None:
    empty = {**rows(), "robots": {}, "channels": {}}
    assert noticed(empty, rows()) == [("robot", "R1", "R1 has started"), ("channel", "", "channel a has started")]


def test_what_ran_before_the_console_is_no_news() -> None:
    connecting = {**rows(), "naming": "connecting", "robots": {}, "channels": {}}
    assert noticed(connecting, {**rows(), "naming": "connecting"}, rows(), rows()) == []


def test_a_lost_naming_service_hides_no_news() -> None:
    lost = {**rows(), "naming": "does not answer"}
    stopped = changed(lost, "robots", "R1", "state", "condition", to="STOPPED")
    assert noticed(rows(), lost, stopped) == [("stop", "R1", "R1 is stopped")]


def test_a_robot_without_any_answer_is_no_error() -> None:
    unknown = changed(rows(), "robots", "R1", to={"state": None, "age": None, "problem": "hangs", "bound": True})
    assert noticed(rows(), unknown) == [("robot", "R1", "R1 does not answer")]


def test_old_happenings_are_forgotten_and_numbers_go_on() -> None:
    happenings = Happenings()
    paused = changed(rows(), "server", "state", "state", "paused", to=True)
    for at_s, step in ((0.0, rows()), (1.0, paused), (KEPT_S + 2.0, rows())):
        happenings.note(step, at_s)
    assert [(each.number, each.text) for each in happenings.after(0)] == [(2, "the simulation goes on")]
    assert happenings.after(2) == []
    assert happenings.last == 2


def test_marks_of_writing_direction_end_with_the_name() -> None:
    before = rows()
    before["robots"] = {"\u202ex": before["robots"]["R1"]}
    after = changed(before, "robots", "\u202ex", "state", "condition", to="STOPPED")
    assert noticed(before, after) == [("stop", "\u202ex", "\u2068\u202ex\u2069 is stopped")]


def test_long_names_are_cut() -> None:
    stopped = changed(rows(), "robots", "R1", "state", "condition", to="STOPPED")
    stopped["robots"]["R1"]["state"]["reason"] = "x" * 5000
    [(_, _, text)] = noticed(rows(), stopped)
    assert len(text) == MAX_TEXT
