"""The communication management agent beside what test_log_on.py tries: its thread, records, scans, and what it refuses;
sensor servers."""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import InvalidChoice, InvalidDescription, SensorRefused, ServerFull, SessionExpired
from robocorba.map_editor.model import ElementKind
from robocorba.map_editor.spatial.pose import Limits, Pose
from robocorba.simulation import management_agent
from robocorba.simulation.load_balance import SENSOR_LEASE_S, Load, LoadBalance
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.registry import Description, Registry
from robocorba.simulation.robot_scans import LastScan
from robocorba.simulation.sensor_admission import SensorAdmission, proof_of, read_token, system_token
from robocorba.simulation.session import Session
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.store import AdministratorSettings, ClientRecord, SimulationStore
from tests.clock import Clock
from tests.simulation.places import robot, scan, tower

PASSAGE, ROOM = (("L1", ((x, 0.0), (x + 2.0, 0.0), (x + 2.0, 1.0), (x, 1.0))) for x in (4.0, 7.0))
GROUND = tower().without(ElementKind.ELEVATOR, "", "E1").without(ElementKind.FLOOR, "", "L2")


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


def test_a_robot_drives_and_its_events_are_published(store: SimulationStore) -> None:
    events: list[SimulationEvent] = []
    agent = ManagementAgent(tower(), 7, store, events.append)
    session = agent.register(robot("A", x=7.5))
    session.command(0.5, 0.0, 0.0, 5.0)
    run(agent, 1.0)
    assert session.state().velocity == pytest.approx((0.5, 0.0, 0.0), abs=0.05)
    run(agent, 5.0)
    assert [(event.kind, event.floor, event.who) for event in events] == [("collision", "L1", ("A",))]
    assert (session.robot.collisions, session.robot.touched) == (1, "")
    assert (agent.state.collisions, agent.state.robots, agent.state.map_version) == (1, 1, 7)


def test_an_exchange_of_areas_that_cannot_be_stored_is_undone(agent: ManagementAgent, store: SimulationStore) -> None:
    agent.register(robot("A")).reserve([PASSAGE], 60.0)
    other = agent.register(robot("B", x=4.0))
    other.reserve([ROOM], 60.0)
    store.__exit__(None, None, None)
    for areas in ([("L2", ROOM[1])], [PASSAGE]):  # what A has is refused, and nothing to be undone
        with pytest.raises(ServiceError):
            other.exchange_areas(areas, 0.0)
        assert agent.simulated.reservations.requests["B"].areas == (ROOM,)


def test_robots_on_a_floor_that_the_map_lost_are_logged_off(store: SimulationStore) -> None:
    gone: list[Session] = []
    agent = ManagementAgent(tower(), 7, store, session_ended=gone.append)
    upstairs = agent.register(robot("A", "L2"))
    agent.register(robot("B", "L1"))
    # As if it was killed before it followed.
    later = ManagementAgent(GROUND, 8, store)
    assert [session.name for session in later.sessions.values()] == ["B"]
    store.save_client(ClientRecord.of(upstairs.client.key, 1.0, robot("A", "L2")))
    agent.follow_map(GROUND, 8)
    agent.close()
    assert gone == [upstairs]
    assert [record.name for record in store.clients()] == ["B"]
    assert (agent.state.robots, agent.state.map_version) == (1, 8)
    for key in ("old", "new"):  # of two records of a name the later one counts
        store.save_client(ClientRecord.of(key, 1.0, robot("A")))
    assert list(ManagementAgent(tower(), 7, store).sessions)[1:] == ["new"]
    assert [record.key for record in store.clients()][1:] == ["new"]


def test_invalid_settings_are_refused(agent: ManagementAgent, monkeypatch: pytest.MonkeyPatch) -> None:
    for choice in ({"limit": -1}, {"limit": 10_001}, {"pace": -1.0}, {"pace": math.inf}):
        with pytest.raises(InvalidChoice):
            agent.configure(**choice)
    assert (agent.state.limit, agent.state.pace) == (300, 1.0)
    monkeypatch.setattr(management_agent, "MAX_KEPT_OUT", 1)
    with pytest.raises(InvalidChoice, match="letters, digits"):
        agent.keep_out("no name")
    agent.keep_out("A")
    agent.keep_out("A")
    with pytest.raises(InvalidChoice, match="1 names are kept out already"):
        agent.keep_out("B")
    with pytest.raises(InvalidDescription, match="robocorba simulation admit A"):
        agent.register(robot("A"))


def test_settings_that_cannot_be_stored_take_no_others_back(
    agent: ManagementAgent, store: SimulationStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(settings: AdministratorSettings) -> None:
        monkeypatch.undo()
        other.start()
        other.join(0.5)
        raise ServiceError("no space left")

    other = threading.Thread(target=lambda: agent.configure(is_paused=True))
    monkeypatch.setattr(store, "save_settings", fail)
    with pytest.raises(ServiceError):
        agent.configure(pace=2.0)
    other.join(60.0)
    kept = AdministratorSettings(300, 1.0, paused=True)
    assert (agent.state.pace, agent.state.is_paused, store.settings()) == (1.0, True, kept)


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
    agent.record_scans([last_scan(0.5)])
    session.deregister()
    began = agent.register(robot("A")).began
    assert database.postures("L1", 0.0) == database.reservations() == []
    for late in ([], [scan("A", 0.9)]):  # of the first A, on its way while that logged off
        agent.record_robot_scans(late)
        agent.record_scans([last_scan(began - 0.1)] * len(late))
        assert database.scans_since("L1", 0.0) == database.last_scans("L1") == []
    agent.record_scans([last_scan(began + 0.1)])
    assert [found.time for found in database.last_scans("L1")] == [began + 0.1]
    for read in (database.postures, database.scans_since):
        with pytest.raises(UnknownFloor):
            read("roof", 0.0)
    with pytest.raises(SessionExpired):
        session.report_posture([0.0])


def last_scan(time_s: float) -> LastScan:
    return LastScan("A", time_s, Pose("L1", 1.0, 2.0, 0.0), 0.0, 0.1, np.ones(3))


# ---- clients and records ----


def test_clients_have_secrets_leases_and_call_rates() -> None:
    clock = Clock()
    registry = Registry(3, clock)
    clients = [registry.register(robot(name)) for name in "ABC"]
    assert len({client.secret for client in clients}) == len({client.key for client in clients}) == 3
    assert all(len(client.secret) >= 32 and client.secret != client.key for client in clients)
    clock.now += 0.5
    clients[0].renew_lease()
    with pytest.raises(ServerFull) as full:
        registry.register(robot("D"))
    assert full.value.retry_s == pytest.approx(1.5)  # until the first lease would end
    clock.now += 0.5
    registry.expired()
    for _ in range(5):
        clock.now += 1.0
        clients[0].renew_lease()
        registry.expired()
    assert [client.call_rate for client in clients] == pytest.approx([1.0, 0.0, 0.0])
    assert [client.silent_s for client in clients] == [0.0, 6.0, 6.0]


def test_an_invalid_description_names_the_field() -> None:
    wrong: list[tuple[str, dict]] = [("name", {"name": name}) for name in ("", "../x", "x" * 61)]
    wrong += [("x", {"pose": Pose("L1", math.nan, 0.0)}), ("y", {"pose": Pose("L1", 0.0, math.inf)})]
    wrong += [("heading", {"pose": Pose("L1", 0.0, 0.0, math.nan)}), ("mass", {"mass_kg": -1.0})]
    wrong += [("radius", {"radius_m": radius_m}) for radius_m in (0.0, math.nan)]
    wrong += [("speed", {"limits": Limits(speed=math.inf)}), ("acceleration", {"limits": Limits(acceleration=0.0)})]
    for field, changed in wrong:
        with pytest.raises(InvalidDescription) as refused:
            Description(**{"name": "A", "pose": Pose("L1", 0.0, 0.0), **changed})
        assert refused.value.field == field


# ---- sensor servers ----


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def balance(clock: Clock) -> LoadBalance:
    return LoadBalance(clock)


def busy(share: float) -> Load:
    return Load(share, 0.01, 10.0, 0)


def report(balance: LoadBalance, **shares: float) -> list[tuple[str, str]]:
    """Servers report how busy they are; the robots that move, and the references of the servers that they leave."""
    return [moved for name, share in shares.items() for moved in balance.report(name, f"IOR:{name}", busy(share))]


def handed(balance: LoadBalance, *robots: str) -> list[str]:
    return [server.name if (server := balance.assign(robot)) else "" for robot in robots]


def test_robots_get_the_least_busy_server_and_keep_it(balance: LoadBalance) -> None:
    assert handed(balance, "early") == [""]
    report(balance, S1=0.0, S2=0.0)
    assert Counter(handed(balance, *(f"R{number}" for number in range(20)))) == {"S1": 10, "S2": 10}
    report(balance, S1=0.18, S2=0.05)  # as many robots, but they ask less
    assert set(handed(balance, *(f"Q{number}" for number in range(5)))) == {"S2"}
    report(balance, S3=0.0)
    assert handed(balance, "Q1") == [balance.name_for("Q1")] == ["S2"]
    balance.release("Q1")
    assert balance.name_for("Q1") == ""
    assert handed(balance, "Q1") == ["S3"]


@pytest.mark.parametrize("is_told", [True, False])
def test_robots_of_a_dead_server_are_reassigned(balance: LoadBalance, clock: Clock, is_told: bool) -> None:
    report(balance, S1=0.1, S2=0.1, S3=0.1)
    robots = [f"R{number}" for number in range(30)]
    before = dict(zip(robots, handed(balance, *robots), strict=True))
    if is_told:
        balance.remove("S2")
    for _ in range(0 if is_told else 2):
        clock.now += 0.6 * SENSOR_LEASE_S
        report(balance, S1=0.1, S3=0.1)
    after = dict(zip(robots, handed(balance, *robots), strict=True))
    assert set(after.values()) == {"S1", "S3"}
    assert all(after[robot] == name for robot, name in before.items() if name != "S2")
    assert abs(Counter(after.values())["S1"] - 15) <= 1
    assert [server.name for server in balance.servers] == ["S1", "S3"]


def test_robots_move_to_a_less_busy_server(balance: LoadBalance) -> None:
    report(balance, S1=0.8)
    robots = [f"R{number}" for number in range(10)]
    handed(balance, *robots)
    moving = report(balance, S1=0.8, S2=0.0)
    assert len(moving) == 5
    assert {reference for _, reference in moving} == {"IOR:S1"}
    assert Counter(handed(balance, *robots)) == {"S1": 5, "S2": 5}
    assert report(balance, S1=0.4, S2=0.4) == []
    for moved in robots[:-1]:
        balance.release(moved)
    assert report(balance, S1=0.9, S2=0.0) == [], "its only robot"


def test_the_token_is_made_once_and_for_this_user_only(tmp_path: Path) -> None:
    file = tmp_path / "sensors.token"
    assert system_token(file) == system_token(file) == read_token(file)
    assert file.stat().st_mode & 0o777 == 0o600
    file.write_text("")
    with pytest.raises(ServiceError, match="damaged"):
        system_token(file)
    assert read_token(tmp_path / "missing") == ""


def test_a_sensor_server_proves_its_name_and_reference_or_is_at_its_own_port(tmp_path: Path) -> None:
    (tmp_path / "ports.json").write_text('{"sensor_s1": 2812, "map_editor": 2810}')
    token = system_token(tmp_path / "sensors.token")
    admission = SensorAdmission(token, tmp_path / "ports.json", "127.0.0.1")
    assert admission.endpoint_of("s1") == "127.0.0.1:2812"
    for name in ("s2", "map_editor", "", "../s1"):
        with pytest.raises(SensorRefused):
            admission.endpoint_of(name)
    good = proof_of(token, "s1", "IOR:1")
    admission.check("s1", "IOR:1", good)
    with pytest.raises(SensorRefused):  # it has a token
        admission.endpoint_of("s1")
    for name, uri, proof in (
        *(("s2", "IOR:1", good), ("s1", "IOR:2", good), ("s1", "IOR:1", proof_of("", "s1", "IOR:1"))),
        *(("s1", "IOR:1", token), ("s1", "IOR:1", ""), ("s1", "IOR:1", "ä\ud800")),
        ("s 1", "IOR:1", proof_of(token, "s 1", "IOR:1")),
    ):
        with pytest.raises(SensorRefused):
            admission.check(name, uri, proof)
