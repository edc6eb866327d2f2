"""What shows that a robot stands, when only some of the ways to stop it work."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest
from omniORB import CORBA

from robocorba.corba.remote import emergency_stop as module
from robocorba.corba.remote.emergency_stop import OTHERS, StopAddresses, Verdict, reset_robots, stop_robots
from robocorba.errors.services import NotReachable
from robocorba.simulation.emergency_stops import StopAnswer, StopRecord
from robocorba.stubs import RoboCorba


class World:
    """An ORB, and what answers behind it. states: of the simulation server, None while it does not answer.
    has_stop_of_all: it is no earlier release."""

    def __init__(self) -> None:
        self.states: list[Any] | None = None
        self.has_stop_of_all, self.held = True, False
        self.targets: dict[str, StopAnswer] = {}
        self.bound: dict[str, str] = {}
        self.asked: list[tuple[str, Sequence[str]]] = []

    def uri_at(self, address: str, key: str) -> str:
        return f"corbaloc:iiop:1.2@{address}/{key}"

    def reference(self, uri: str, interface: Any, timeout_s: float) -> World:
        if interface is not RoboCorba.SimulationServer:
            raise NotReachable("no channel")
        self.asked.append((uri, ()))
        return self

    def resolve(self, name: str, *arguments: Any) -> World:
        raise NotReachable(f"{name}: the naming service hangs")

    def names(self, path: str, timeout_s: float = 1.0) -> list[str]:
        raise NotReachable("the naming service hangs")

    def stopRobots(self, robots: Sequence[str], reason: str) -> list[Any]:
        if self.states is None:
            raise CORBA.TIMEOUT()
        self.held |= not robots
        return [state for state in self.states if not robots or state.robot in robots]

    def _get_stopOfAll(self) -> Any:
        if not self.has_stop_of_all:
            raise CORBA.BAD_OPERATION()
        return RoboCorba.StopHold(self.held, 7, "fire")

    def endStopOfAll(self, last: int) -> Any:
        if self.states is None:
            raise CORBA.TIMEOUT()
        self.held &= last != 7
        return self._get_stopOfAll()

    def stopStates(self, robots: Sequence[str]) -> list[Any]:
        return self.stopRobots(robots, "")


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    world = World()

    def stop_at(orb: Any, target: str, reason: str) -> StopAnswer:
        if target not in world.targets:
            raise NotReachable("gone")
        return world.targets[target]

    def order_all(
        orb: Any, names: Sequence[str], order: Callable[..., None], limits: Any = None
    ) -> Iterator[tuple[str, str]]:
        yield from ((name, world.bound.get(name, "is not bound")) for name in names)

    def robots(orb: Any) -> list[str]:
        return list(world.bound)

    monkeypatch.setattr(module, "LIMIT_S", 0.3)
    monkeypatch.setattr(module, "stop_at", stop_at)
    monkeypatch.setattr(module, "order_all", order_all)
    monkeypatch.setattr(module, "robots", robots)
    yield world


def stop(world: World, *names: str, targets: Sequence[str] = ()) -> list[Verdict]:
    known = {name: StopRecord("r", name) for name in targets}
    return stop_robots(world, names, StopAddresses("h:1", {}, known))  # type: ignore[arg-type]


def state(robot: str, waits_for: str = "", is_confirmed: bool = True) -> Any:
    return RoboCorba.StopState(robot, True, not waits_for, 0.0, is_confirmed, waits_for)


def test_the_simulation_server_at_its_own_address_shows_it_without_names(world: World) -> None:
    world.states = [state("A"), state("B", is_confirmed=False)]
    *robots, others = stop(world)
    assert robots == [Verdict("A", True, "the robot confirms it"), Verdict("B", True, "its body stands")]
    assert others == (OTHERS, True, "robots that log on are stopped, too, until: robocorba stop --all --reset", True)
    assert world.asked[0][0] == "corbaloc:iiop:1.2@h:1/SimulationServer"


def test_a_robot_that_still_moves_does_not_stand_whatever_it_says(world: World) -> None:
    world.states, world.targets, world.bound = [state("A", "it brakes")], {"A": StopAnswer(True, True)}, {"A": ""}
    assert stop(world, "A", targets="A") == [Verdict("A", False, "is not shown to stand: it brakes")]


def test_what_is_bound_to_a_name_proves_nothing(world: World) -> None:
    world.bound = {"A": ""}
    (verdict,) = stop(world, "A")
    assert not verdict.stands and "proves nothing; the simulation server does not answer" in verdict.text
    world.states = []
    verdict, _ = stop(world)
    assert (verdict.stands, verdict.is_known) == (False, False)
    assert verdict.text.endswith("proves nothing; it is not logged on")


def test_without_the_server_a_robot_speaks_for_itself_and_others_are_doubtful(world: World) -> None:
    world.targets = {"A": StopAnswer(True, True), "B": StopAnswer(True, False)}
    found = {verdict.robot: verdict.stands for verdict in stop(world, targets="ABC")}
    assert found == {"A": True, "B": False, "C": False, OTHERS: False}
    assert [verdict.stands for verdict in stop(world, "A", targets="ABC")] == [True]


def test_without_any_way_nothing_is_claimed(world: World) -> None:
    (verdict,) = stop(world)
    assert verdict.robot == OTHERS and not verdict.stands


def test_a_server_of_an_earlier_release_holds_no_robot_that_logs_on(world: World) -> None:
    world.states, world.has_stop_of_all = [], False
    (others,) = stop(world)
    assert (others.robot, others.stands, others.is_known) == (OTHERS, False, False)
    assert reset(world) == {OTHERS: ""}


def test_a_reset_of_all_ends_the_stop_of_all_and_resets_each_robot(world: World) -> None:
    world.states, world.bound = [state("A"), state("B")], {"A": "", "B": "is not bound"}
    stop(world)
    assert reset(world, "A") == {"A": ""} and world.held
    assert reset(world) == {OTHERS: "", "A": "", "B": "is not bound"}
    assert not world.held
    world.states = None
    assert reset(world)[OTHERS].startswith("robots that log on stay stopped: the simulation server does not answer")


def reset(world: World, *names: str) -> dict[str, str]:
    return dict(reset_robots(world, names, StopAddresses("h:1")))  # type: ignore[arg-type]
