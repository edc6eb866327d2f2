"""The communication management agent: log-on, leases, restart after a kill."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import (
    InvalidChoice,
    InvalidReservation,
    NameTaken,
    PlaceTaken,
    ServerFull,
    SessionExpired,
    UnknownRobot,
)
from robocorba.maps.model import ElementKind
from robocorba.simulation.elevator import RidePhase
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.robot_scans import LastScan
from robocorba.simulation.session import Session
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.store import ClientRecord, SimulationStore
from robocorba.spatial.pose import Pose
from robocorba.testing.processes import eventually
from tests.simulation.places import robot, scan, tower
from tests.waits import stays

PASSAGE = ("L1", ((4.0, 0.0), (6.0, 0.0), (6.0, 1.0), (4.0, 1.0)))

ROOM, FAR, HALL = (("L1", ((x, 2.0), (x + 1.0, 2.0), (x + 1.0, 3.0), (x, 3.0))) for x in (1.0, 3.0, 5.0))


@pytest.fixture
def store(tmp_path: Path) -> Iterator[SimulationStore]:
    with SimulationStore(tmp_path / "simulation.sqlite") as store:
        yield store


@pytest.fixture
def agent(store: SimulationStore) -> ManagementAgent:
    """An agent whose time a test steps or starts."""
    return ManagementAgent(tower(), 7, store)


def run(agent: ManagementAgent, seconds: float) -> None:
    for _ in range(round(seconds / STEP_S)):
        agent.step()


def test_a_robot_logs_on_drives_and_logs_off(agent: ManagementAgent) -> None:
    session = agent.register(robot("A"))
    assert session.state().pose == ("L1", 7.0, 2.0, 0.0)
    session.command(0.5, 0.0, 0.0, 1.0)
    run(agent, 1.0)
    assert session.state().velocity == pytest.approx((0.5, 0.0, 0.0), abs=0.05)
    assert session.state().pose.x > 7.2
    assert (agent.state.robots, agent.state.map_version) == (1, 7)
    session.deregister()
    for call in (session.state, session.heartbeat, session.deregister, session.release):
        with pytest.raises(SessionExpired):
            call()
    assert agent.state.robots == 0
    agent.register(robot("A"))


@pytest.mark.parametrize(
    "call",
    [Session.release, Session.release_areas, Session.cancel_elevator, lambda session: session.keep_areas([])],
    ids=["release", "release areas", "cancel the ride", "keep areas"],
)
def test_a_call_that_waits_while_its_robot_is_logged_off_changes_nothing(
    agent: ManagementAgent, call: Callable[[Session], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if another robot of the same name has logged on meanwhile."""
    session, do = agent.register(robot("A")), agent.loop.do
    second = []

    def wait_for_the_thread(change: Callable[[], None]) -> object:
        monkeypatch.setattr(agent.loop, "do", do)
        agent.evict("A")
        second.append(agent.register(robot("A")))
        second[0].reserve([PASSAGE], 60.0)
        return do(change)

    monkeypatch.setattr(agent.loop, "do", wait_for_the_thread)
    with pytest.raises(SessionExpired):
        call(session)
    assert second[0].reservation() == (True, 0, 0.0, 60.0)


def test_areas_are_reserved_and_released(agent: ManagementAgent) -> None:
    first, second = agent.register(robot("A")), agent.register(robot("B", x=4.0))
    assert first.reservation() is None
    first.release_areas()
    for field, areas, limit_s in (("areas", [], 1.0), ("limit", [PASSAGE], -1.0)):
        with pytest.raises(InvalidReservation) as refused:
            first.reserve(areas, limit_s)
        assert refused.value.field == field
    with pytest.raises(UnknownFloor):
        first.reserve([("roof", PASSAGE[1])], 1.0)
    first.reserve([PASSAGE, ("L2", PASSAGE[1])], 60.0)
    second.reserve([PASSAGE], 60.0)
    assert (first.reservation(), second.reservation()) == ((True, 0, 0.0, 60.0), (False, 1, 60.0, 60.0))
    first.keep_areas([("L2", PASSAGE[1])])
    assert second.reservation() == (True, 0, 0.0, 60.0)
    second.deregister()
    for call in (second.reservation, second.release_areas, lambda: second.reserve([PASSAGE], 1.0)):
        with pytest.raises(SessionExpired):
            call()
    with pytest.raises(InvalidReservation):
        first.keep_areas([PASSAGE])
    first.release_areas()
    assert agent.simulated.reservations.requests == {}


def test_a_refused_log_on_leaves_no_record(agent: ManagementAgent, store: SimulationStore) -> None:
    agent.configure(limit=2)
    agent.register(robot("A"))
    refused: list[tuple[type, Callable[[], object]]] = [
        (NameTaken, lambda: agent.register(robot("A", x=4.0))),
        (PlaceTaken, lambda: agent.register(robot("B"))),
        (UnknownFloor, lambda: agent.register(robot("B", "roof"))),
    ]
    for error, call in refused:
        with pytest.raises(error):
            call()
    agent.register(robot("B", x=4.0))
    with pytest.raises(ServerFull):
        agent.register(robot("C", x=5.0))
    assert set(agent.simulated.occupants.robots) == {"A", "B"} == {record.name for record in store.clients()}


def test_a_log_on_that_cannot_be_stored_is_refused(agent: ManagementAgent, store: SimulationStore) -> None:
    store.__exit__(None, None, None)
    with pytest.raises(ServiceError):
        agent.register(robot("A"))
    assert agent.simulated.occupants.robots == {}
    assert agent.state.robots == 0


def test_what_cannot_be_stored_is_undone(agent: ManagementAgent, store: SimulationStore) -> None:
    driver = agent.register(robot("A", x=1.0))
    store.__exit__(None, None, None)
    for change in (
        lambda: driver.grip("T1", (1.6, 2.0)),
        lambda: driver.call_elevator("E1", "L2"),
        lambda: driver.reserve([PASSAGE], 100.0),
        lambda: agent.configure(limit=5, pace=2.0, is_paused=True),
    ):
        with pytest.raises(ServiceError):
            change()
    run(agent, 0.1)
    assert (driver.robot.holding, driver.ride, driver.reservation()) == ("", None, None)
    assert (agent.registry.limit, agent.loop.pace, agent.loop.is_paused) == (300, 1.0, False)


def test_changes_of_areas_that_cannot_be_stored_are_undone(agent: ManagementAgent, store: SimulationStore) -> None:
    leader, successor, other = agent.register(robot("A", x=1.0)), agent.register(robot("B")), robot("C", x=4.0)
    agent.register(other).reserve([PASSAGE], 60.0)
    leader.reserve([ROOM], 60.0)
    successor.reserve([FAR], 60.0)
    agent.simulated.reservations.fall_silent("A")
    store.__exit__(None, None, None)
    with pytest.raises(ServiceError):
        successor.exchange_areas([HALL], 0.0)
    reserved = agent.simulated.reservations.requests
    assert reserved["B"].areas == (FAR,)
    with pytest.raises(ServiceError):  # what C has; it is refused, and nothing to be undone
        successor.exchange_areas([PASSAGE], 0.0)
    assert reserved["B"].areas == (FAR,)
    agent.simulated.reservations.release("B")
    with pytest.raises(ServiceError):
        successor.take_over_areas("A")
    agent.simulated.reservations.take_over("B", "A")  # it is kept of A again
    assert reserved["B"].areas == (ROOM,)


def test_a_robot_whose_lease_expires_is_logged_off(store: SimulationStore) -> None:
    gone: list[Session] = []
    agent = ManagementAgent(tower(), 7, store, session_ended=gone.append)
    with contextlib.closing(agent):
        agent.start()
        agent.begin_leases()
        silent, alive = agent.register(robot("A")), agent.register(robot("B", x=4.0))

        def is_gone() -> bool:
            alive.heartbeat()
            return bool(gone)

        eventually(is_gone)
        assert gone == [silent]
        eventually(lambda: [record.name for record in store.clients()] == ["B"])
        agent.register(robot("A"))
        with pytest.raises(UnknownRobot):
            agent.evict("C")
        agent.evict("A")
    assert [session.name for session in gone] == ["A", "A"]


def test_accepted_changes_survive_a_kill(store: SimulationStore) -> None:
    killed = ManagementAgent(tower(), 7, store)
    killed.configure(limit=5, pace=2.0)
    killed.start()
    driver, waiter = killed.register(robot("A", x=1.0)), killed.register(robot("B", x=5.0, y=3.0))
    driver.grip("T1", (1.6, 2.0))
    waiter.call_elevator("E1", "L2", "table", 2)
    driver.reserve([PASSAGE], 100.0)
    waiter.reserve([PASSAGE], 200.0)
    # Nothing is closed: its thread goes on, but what it keeps from now on goes into a file of its own.
    kept = store.world()
    clients, settings = store.clients(), store.settings()
    killed.close()
    store.clear()
    for client in clients:
        store.save_client(client)
    assert kept is not None and settings is not None
    store.save_world(kept)
    store.save_settings(settings)

    again = ManagementAgent(tower(), 7, store)
    assert (again.state.limit, again.state.pace) == (5, 2.0)
    assert set(again.sessions) == {driver.client.key, waiter.client.key}
    session = again.sessions[driver.client.key]
    assert session.robot.holding == "T1"
    assert session.state().pose[1:] == pytest.approx((1.0, 2.0, 0.0), abs=0.01)
    ride = again.sessions[waiter.client.key].ride
    assert ride is not None and ride.phase is RidePhase.WAITING
    assert again.simulated.elevators.cabins["E1"].sessions["B"].party == "table"
    first, second = session.reservation(), again.sessions[waiter.client.key].reservation()
    assert first is not None and first.granted and 99.0 < first.left_s <= 100.0
    assert second == (False, 1, pytest.approx(first.left_s), 200.0)
    with pytest.raises(NameTaken):
        again.register(robot("A", x=4.0))


def test_a_robot_on_a_floor_that_the_map_lost_is_not_restored(store: SimulationStore) -> None:
    before = ManagementAgent(tower(), 7, store)
    before.register(robot("A", "L2"))
    before.register(robot("B", "L1"))
    ground = tower().without(ElementKind.ELEVATOR, "", "E1").without(ElementKind.FLOOR, "", "L2")
    after = ManagementAgent(ground, 8, store)
    assert [session.name for session in after.sessions.values()] == ["B"]
    assert [record.name for record in store.clients()] == ["B"]


def test_a_robot_does_not_inherit_the_pose_of_an_earlier_robot_of_its_name(store: SimulationStore) -> None:
    before = ManagementAgent(tower(), 7, store)
    before.register(robot("A", x=4.0)).deregister()
    before.close()
    store.save_client(ClientRecord.of("another", 1.0, robot("A", "L2")))
    (session,) = ManagementAgent(tower(), 7, store).sessions.values()
    assert session.state().pose == ("L2", 7.0, 2.0, 0.0)


def test_late_scans_of_an_earlier_robot_of_the_same_name_are_ignored(store: SimulationStore) -> None:
    agent = ManagementAgent(tower(), 7, store)
    began = agent.register(robot("A")).began

    def last_scan(time_s: float) -> LastScan:
        return LastScan("A", time_s, Pose("L1", 1.0, 2.0, 0.0), 0.0, 0.1, np.ones(3))

    agent.record_scans([last_scan(began - 0.1)])
    assert agent.database.last_scans("L1") == []
    agent.record_scans([last_scan(began + 0.1)])
    assert [found.time for found in agent.database.last_scans("L1")] == [began + 0.1]


def test_leases_begin_when_calls_are_accepted(store: SimulationStore) -> None:
    agent = ManagementAgent(tower(), 7, store)
    agent.registry.lease_s = 0.2
    with contextlib.closing(agent):
        agent.start()
        agent.register(robot("A"))
        stays(lambda: agent.state.robots == 1, 0.5)
        agent.begin_leases()
        eventually(lambda: agent.state.robots == 0)


def test_of_two_records_of_a_name_the_later_one_counts(store: SimulationStore) -> None:
    for key in ("old", "new"):
        store.save_client(ClientRecord.of(key, 1.0, robot("A")))
    assert list(ManagementAgent(tower(), 7, store).sessions) == ["new"]
    assert [record.key for record in store.clients()] == ["new"]


def test_robots_on_a_removed_floor_are_logged_off(store: SimulationStore) -> None:
    gone: list[Session] = []
    agent = ManagementAgent(tower(), 7, store, session_ended=gone.append)
    upstairs = agent.register(robot("A", "L2"))
    agent.register(robot("B", "L1"))
    agent.follow_map(tower().without(ElementKind.ELEVATOR, "", "E1").without(ElementKind.FLOOR, "", "L2"), 8)
    assert gone == [upstairs]
    agent.close()
    assert [record.name for record in store.clients()] == ["B"]
    assert (agent.state.robots, agent.state.map_version) == (1, 8)


def test_events_are_published(store: SimulationStore) -> None:
    events: list[SimulationEvent] = []
    agent = ManagementAgent(tower(), 7, store, events.append)
    session = agent.register(robot("A", x=8.5, heading=0.0))
    session.command(0.5, 0.0, 0.0, 5.0)
    run(agent, 4.0)
    assert [(event.kind, event.who) for event in events] == [("collision", ("A",))]
    assert (agent.state.collisions, session.robot.collisions, session.robot.touched) == (1, 1, "")


@pytest.mark.parametrize("choice", [{"limit": -1}, {"limit": 10_001}, {"pace": -1.0}, {"pace": math.inf}])
def test_invalid_settings_are_refused(agent: ManagementAgent, choice: dict) -> None:
    with pytest.raises(InvalidChoice):
        agent.configure(**choice)
    assert (agent.state.limit, agent.state.pace) == (300, 1.0)


def test_a_placed_body_is_there_after_a_kill(store: SimulationStore) -> None:
    events: list[SimulationEvent] = []
    agent = ManagementAgent(tower(), 7, store, events.append)
    agent.register(robot("A"))
    agent.place("A", Pose("L2", 3.0, 3.0, 1.0))
    agent.place("T1", Pose("L1", 6.0, 2.0, 1.0))
    assert [(event.kind, event.who) for event in events] == [("placed", ("A",)), ("placed", ("T1",))]
    with pytest.raises(PlaceTaken):
        agent.place("A", Pose("L1", 6.0, 2.0, 0.0))
    after = ManagementAgent(tower(), 7, store)  # the first one was not closed
    assert after.simulated.occupants.pose("A") == pytest.approx(Pose("L2", 3.0, 3.0, 1.0))
    assert after.simulated.occupants.object_pose("T1") == pytest.approx(Pose("L1", 6.0, 2.0, 1.0))


def test_postures_reservations_and_scans_of_a_robot_end_with_its_session(agent: ManagementAgent) -> None:
    session, database = agent.register(robot("A")), agent.database
    agent.register(robot("B", x=5.0))
    assert database.postures("L1", 0.0) == []
    run(agent, 1.0)
    session.report_posture([0.1, 0.2])
    assert database.postures("L1", 0.0) == [("A", pytest.approx(1.0), (0.1, 0.2))]
    assert database.postures("L1", 1.5) == database.postures("L2", 0.0) == []
    session.reserve([PASSAGE], 30.0)
    assert [(kept.robot, kept.areas) for kept in database.reservations()] == [("A", (PASSAGE,))]
    assert agent.record_robot_scans([scan("A"), scan("nobody")]) > 0.1
    assert [found.robot for found in database.scans_since("L1", 0.0)] == ["A"]
    assert agent.record_robot_scans([]) < 0.1  # somebody reads them
    session.deregister()
    assert database.postures("L1", 0.0) == []
    assert database.reservations() == []
    assert database.scans_since("L1", 0.0) == []
    agent.register(robot("A"))
    agent.record_robot_scans([scan("A", 0.9)])  # of the first A, on its way while that logged off
    assert database.scans_since("L1", 0.0) == []
    for read in (database.postures, database.scans_since):
        with pytest.raises(UnknownFloor):
            read("roof", 0.0)
    with pytest.raises(SessionExpired):
        session.report_posture([0.0])
