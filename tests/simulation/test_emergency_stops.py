"""Emergency stops at the simulation server: bodies are held, robots are called, and both outlive a restart."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import InvalidCommand, SessionExpired, UnknownRobot
from robocorba.simulation import emergency_stops
from robocorba.simulation.emergency_stops import ALL, EmergencyStops, StopAnswer, read_records
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.session import Session
from robocorba.simulation.simulated_robot import STOPPED
from robocorba.simulation.store import SimulationStore
from testkit.processes import eventually
from tests.simulation.places import robot, tower

PATIENCE_S = 30.0
CONFIRMED = StopAnswer(True, True, "emergency stop")


class Scene:
    """A simulation whose time a test steps. calls: of stop targets; answers: of these, CONFIRMED by default."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "stops.json"
        self._closing = contextlib.ExitStack()
        self.agent = ManagementAgent(
            *(tower(), 7, self._closing.enter_context(SimulationStore(folder / "simulation.sqlite"))),
            session_began=lambda session: self.stops.admit(session),
            session_ended=lambda session: self.stops.forget(session),
        )
        self.calls: list[tuple[str, str, int]] = []
        self.published: list[tuple[Sequence[str], str]] = []
        self.answers: dict[str, StopAnswer] = {}
        self.is_paused = False
        self.stops = EmergencyStops(
            self.file,
            lambda: list(self.agent.sessions.values()),
            lambda: self.is_paused,
            self._call,
            lambda robots, reason: self.published.append((robots, reason)),
        )

    def _call(self, target: str, reason: str, number: int) -> StopAnswer:
        self.calls.append((target, reason, number))
        if target == "hangs":
            raise NotReachable("TIMEOUT")
        if target == "defect":
            raise KeyError("confirmed")
        return self.answers.get(target, CONFIRMED)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.agent.step()

    def close(self) -> None:
        self.stops.close()
        self._closing.close()


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    monkeypatch.setattr(emergency_stops.secrets, "randbits", lambda count: 0)  # stops have the numbers 1, 2, ...
    with contextlib.closing(Scene(tmp_path)) as scene:
        yield scene


@contextlib.contextmanager
def restarted(scene: Scene) -> Iterator[Scene]:
    scene.close()
    with contextlib.closing(Scene(scene.file.parent)) as again:
        again.stops.start()
        yield again


def refuses(session: Session) -> bool:
    try:
        session.command(0.5, 0.0, 0.0, 5.0)
    except InvalidCommand as error:
        assert error.field == STOPPED
        return True
    return False


def test_a_stopped_robot_brakes_and_refuses_commands_until_it_is_reset(scene: Scene) -> None:
    session = scene.agent.register(robot("A"))
    session.command(0.5, 0.0, 0.0, 5.0)
    scene.run(1.0)
    (state,) = scene.stops.stop(["A", "nobody"], "fire")
    assert (state.robot, state.is_held, state.stands) == ("A", True, False)
    assert state.waits_for.startswith("it brakes, 0.5")
    scene.is_paused = True
    assert scene.stops.state(session).stands
    scene.is_paused = False
    with pytest.raises(InvalidCommand, match="fire") as refused:
        session.command(0.5, 0.0, 0.0, 5.0)
    assert refused.value.field == STOPPED
    scene.run(0.3)
    (state,) = scene.stops.stop([], "again")
    assert state.stands and state.speed < 0.01
    assert scene.published == [(["A"], "fire")]
    scene.stops.reset(session)
    session.command(0.5, 0.0, 0.0, 5.0)
    scene.run(0.5)
    assert session.state().velocity[0] > 0.3


def test_an_actual_robot_stands_only_when_it_confirms_that(scene: Scene) -> None:
    session = scene.agent.register(robot("A"))
    scene.answers["unit"] = StopAnswer(True, False, "a motor does not answer")
    scene.stops.report_target(session, "unit", False)
    (state,) = scene.stops.stop([], "")
    assert (state.stands, state.waits_for) == (False, "the actual robot has not confirmed the stop")
    eventually(lambda: scene.calls, PATIENCE_S)
    scene.answers.clear()
    eventually(lambda: (state := scene.stops.stop([], "")[0]).stands and state.is_confirmed, PATIENCE_S)


def test_a_robot_that_does_not_confirm_holds_up_no_other_and_why_is_in_the_answer(
    scene: Scene, caplog: pytest.LogCaptureFixture
) -> None:
    """Also a defect of the call; and once in the log, however often it is called."""
    problems = {"hangs": "TIMEOUT", "defect": "internal fault"}
    for number, target in enumerate((*problems, "confirms")):
        scene.stops.report_target(scene.agent.register(robot(target, x=5.0 + number)), target, False)
    scene.stops.stop([], "fire")

    def shown() -> bool:
        states = {state.robot: state for state in scene.stops.states([])}
        if states["hangs"].is_confirmed or not states["confirms"].is_confirmed:
            return False
        return all(f"not confirmed the stop: {each}" in states[name].waits_for for name, each in problems.items())

    eventually(shown, PATIENCE_S)
    calls = len(scene.calls)
    eventually(lambda: scene.stops.states([]) and len(scene.calls) > calls + 6, PATIENCE_S)
    warnings = [record.getMessage() for record in caplog.records if "does not confirm" in record.getMessage()]
    assert len(warnings) == len(problems)


def test_a_stop_of_a_robot_that_restarts_waits_for_it_and_names_that_never_existed_fill_no_disk(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(emergency_stops, "MAX_ABSENT", 2)
    session = scene.agent.register(robot("A"))
    assert scene.stops.stop(["X1", "X2", "not a name"], "fire") == []
    scene.stops.stop(["X3", "A"], "")
    assert set(read_records(scene.file)) == {"A", "X1", "X2"}
    assert refuses(session)
    with restarted(scene) as again:
        session = again.agent.register(robot("X1", x=5.0))
        assert refuses(session)
        assert not refuses(again.agent.register(robot("B", x=3.5)))
        session.deregister()
        again.stops.reset_robot("X1")
        with pytest.raises(UnknownRobot):
            again.stops.reset_robot("X1")
        assert not refuses(again.agent.register(robot("X1", x=5.0)))


def test_a_robot_reports_a_stop_of_its_own_which_holds_over_a_restart(scene: Scene) -> None:
    scene.stops.start()
    session = scene.agent.register(robot("A"))
    scene.stops.report_target(session, "unit", True)
    assert scene.stops.report_stop(session, "button") == (True, (True, 1, "button"))
    assert scene.stops.report_stop(session, "event") == (False, (True, 1, "button"))
    assert scene.stops.end(session, 2) == (True, 1, "button")  # no stop of this number yet
    assert refuses(session)
    assert scene.calls == scene.published == []
    assert (read_records(scene.file)["A"].held, scene.file.stat().st_mode & 0o077) == ("button", 0)
    with restarted(scene) as again:
        (session,) = again.agent.sessions.values()
        seen = again.stops.hold(session)
        assert seen == (True, 1, "button")
        again.stops.stop(["A"], "smoke")
        eventually(lambda: again.calls == [("unit", "button", 2)], PATIENCE_S)
        assert again.stops.end(session, seen.number) == (True, 2, "smoke")  # it has not seen that one
        assert refuses(session)
        assert again.stops.end(session, 2) == (False, 2, "")
        assert not refuses(session)
        session.deregister()
        with pytest.raises(SessionExpired):
            again.stops.report_stop(session, "late")


def test_each_stop_is_delivered_to_the_robot_and_holds_the_next_one_of_its_name(scene: Scene) -> None:
    """Also a second one: the robot has to know its number for a reset."""
    scene.stops.start()
    session = scene.agent.register(robot("A"))
    scene.stops.report_target(session, "unit", True)
    for number in (1, 2):
        scene.stops.stop(["A"], "fire")
        eventually(lambda number=number: len(scene.calls) == number, PATIENCE_S)
        eventually(lambda: scene.stops.state(session).is_confirmed, PATIENCE_S)
        scene.stops.states(["A"])  # only looks
    assert scene.calls == [("unit", "fire", 1), ("unit", "fire", 2)]
    session.deregister()
    session = scene.agent.register(robot("A"))
    assert refuses(session)
    assert scene.stops.hold(session) == (True, 2, "fire")
    scene.stops.stop(["A"], "again")
    assert len(scene.calls) == 2  # not the former robot's target
    scene.stops.reset(session)
    assert not refuses(session)
    session.deregister()
    eventually(lambda: not read_records(scene.file), PATIENCE_S)


def test_stops_of_the_first_release_hold(scene: Scene) -> None:
    scene.file.write_text('{"A": {"registration": "x", "target": "unit", "stands_with_body": true, "held": "fire"}}')
    scene.stops.start()
    assert scene.stops.hold(session := scene.agent.register(robot("A"))) == (True, 1, "fire")
    assert refuses(session)


def test_stops_work_without_a_disk(scene: Scene) -> None:
    in_the_way = scene.file.with_suffix(".new")
    in_the_way.mkdir()
    scene.stops.start()
    session = scene.agent.register(robot("A"))
    scene.stops.stop(["A"], "fire")
    assert refuses(session)
    in_the_way.rmdir()
    eventually(lambda: scene.file.is_file() and read_records(scene.file)["A"].held == "fire", PATIENCE_S)


def test_a_stop_of_all_holds_robots_that_log_on_until_it_is_ended(scene: Scene) -> None:
    session = scene.agent.register(robot("A"))
    scene.stops.stop([], "fire")
    scene.stops.reset(session)
    assert not refuses(session)  # one robot may be reset alone
    later = scene.agent.register(robot("B", x=5.0))
    assert refuses(later)
    assert "all robots are stopped, until: robocorba stop --all --reset (fire)" in scene.stops.hold(later).reason
    with restarted(scene) as again:
        sessions = {session.name: session for session in again.agent.sessions.values()}
        assert {name: refuses(session) for name, session in sessions.items()} == {"A": False, "B": True}
        assert refuses(again.agent.register(robot("C", x=9.0)))
        hold = again.stops.stop_of_all
        assert hold == (True, 1, "fire")
        again.stops.stop([], "smoke")
        assert again.stops.end_stop_of_all(hold.number) == (True, 2, "smoke")
        assert read_records(scene.file)[ALL].held == "smoke"
        assert again.stops.end_stop_of_all(2) == (False, 2, "")
        assert not read_records(scene.file)[ALL].held
        assert not refuses(again.agent.register(robot("D", x=7.0, y=5.0)))
        assert refuses(sessions["B"])  # until it is reset


@given(
    st.one_of(
        st.binary(), st.sampled_from([b"", b"[]", b'{"A": {"number": -1}}', b'{"A": {"held": 1}}', b"{", b"null"])
    )
)
@settings(max_examples=25, deadline=None)
def test_if_the_file_can_not_be_read_all_robots_are_stopped(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as closing:
        with contextlib.closing(Scene(Path(folder))) as scene:
            scene.agent.register(robot("A"))
        scene.file.write_bytes(content)
        scene = closing.enter_context(contextlib.closing(Scene(Path(folder))))
        scene.stops.start()
        (session,) = scene.agent.sessions.values()
        assert refuses(session) and "stops.json could not be read" in scene.stops.hold(session).reason
        assert not scene.stops.end(session, 100).number < 100  # numbers that a robot remembers are of no stop now
        assert refuses(session)
        assert refuses(scene.agent.register(robot("B", x=5.0)))
        assert scene.file.with_name("stops.json.damaged").read_bytes() == content
        assert read_records(scene.file)[ALL].held
        scene.stops.end_stop_of_all(scene.stops.stop_of_all.number)
        scene.stops.reset(session)
        assert not refuses(session)


def test_a_file_that_can_be_neither_read_nor_set_aside_stops_all_robots(scene: Scene) -> None:
    scene.file.mkdir()
    scene.file.with_name("stops.json.damaged").write_text("")
    scene.stops.start()
    assert refuses(scene.agent.register(robot("A")))
