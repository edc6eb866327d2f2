"""A guarded system, attacked as observer and as robot."""

from __future__ import annotations

import functools
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import CosNaming
import pytest
from omniORB import CORBA

from robocorba.errors.services import NotPermitted
from robocorba.map_editor import native
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.simulation.mission_record import MissionContent
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.roles import Role
from robocorba.system.settings import RoleNaming, role_file
from robocorba.system.supervision.stop_addresses import stop_addresses
from testkit.buildings import two_floors
from testkit.intrusion.intruder import WAYS, Intruder
from testkit.processes import ROBOCORBA, Launcher, Running, eventually, running_system
from testkit.simulation import about

pytestmark = [pytest.mark.system, pytest.mark.full]

ATTACKERS = (Role.OBSERVER, Role.ROBOT)
SECRET = "a secret of the attacker"
#: Time limit for restarts, names and rights [s].
PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A guarded system with a robot A."""
    folder = tmp_path_factory.mktemp("guarded")
    native.save(two_floors(), folder / "two-floors.yaml")
    options = ("--building", "two-floors.yaml", "--subnets", "a", "--guarded", "--bidirectional")
    with running_system(folder, *options) as (running, launch):
        robot = launch(ROBOCORBA, "robot", "A", "--channel", "a", "--state", str(running.state))
        assert robot.stdout is not None
        assert robot.stdout.readline() == "ready\n"
        yield running
        robot.send_signal(signal.SIGTERM)
        robot.communicate(timeout=PATIENCE_S)
        assert running.stop() == 0


@pytest.fixture(scope="module")
def orb(guarded: Running) -> Iterator[Orb]:
    """An ORB that knows the address of the naming service only, as an observer's."""
    with Orb(guarded.naming) as orb:
        eventually(lambda: "A" in orb.names("Robots"), PATIENCE_S, "the robot's name")
        yield orb


class Ignoring(RoboCorba__POA.EventConsumer):
    """A consumer that takes whatever arrives."""

    push = pushRuns = pushTogether = disconnect_push_consumer = lambda self, *arguments: None


def names_of(orb: Orb, guarded: Running, role: Role) -> Any:
    return orb.reference(role_file(guarded.state, role).read_text().strip(), CosNaming.NamingContextExt, 10.0)


def found(orb: Orb, guarded: Running, role: Role, name: str) -> Any:
    return names_of(orb, guarded, role).resolve_str(f"RoboCorba/{name}")


def refused(call: Any, *arguments: Any, by: type[Exception] = CORBA.NO_PERMISSION) -> None:
    with pytest.raises(by):
        call(*arguments)


@pytest.mark.parametrize("role", ATTACKERS)
def test_a_role_calls_what_it_may_and_nothing_else(orb: Orb, guarded: Running, role: Role) -> None:
    """Every operation of every object that it finds by a name, or that such an object returns."""
    intruder = Intruder(orb, role, names_of(orb, guarded, role), orb.activate(Ignoring()), {}, {})
    intruder.attack(intruder.by_name)
    findings = intruder.findings
    assert (findings.more, findings.less, findings.unanswered) == ([], [], [])
    reached = {title for title, is_reached in findings.reached.items() if is_reached}
    assert reached == {way.title for way in WAYS if role in way.may}
    assert findings.pairs + findings.out_of_reach > 200


def test_keys_cannot_be_guessed(orb: Orb, guarded: Running) -> None:
    endpoint = next(process.endpoint for process in guarded.record().processes if process.name == "events_a")
    for key in ("consumers", "suppliers", "feed", "gateway", "proxies/0", "proxies/1", "proxies/2"):
        uri = f"corbaloc:iiop:1.2@{endpoint}/EventChannels/a/{key}"
        assert orb.reference(uri, CosNaming.NamingContext, 5.0)._non_existent()


def test_an_operator_edits_and_stops(orb: Orb, guarded: Running, tmp_path: Path) -> None:
    with pytest.raises(NotPermitted, match="--naming"):
        RemoteAgent(orb, "A").stop()
    operator = str(role_file(guarded.state, Role.OPERATOR))
    with Launcher(tmp_path) as launch:
        said = launch(ROBOCORBA, "stop", "A", ROBOCORBA_NAMING=str(guarded.naming)).communicate(timeout=PATIENCE_S)
        assert "access/operator.ior" in said[1]
        assert RemoteAgent(orb, "A").state().condition is not AgentCondition.STOPPED
        for options in (("--naming", operator), ("--state", str(guarded.state))):
            process = launch(ROBOCORBA, "stop", "A", *options)
            assert process.communicate(timeout=PATIENCE_S)[1] == ""
            assert process.returncode == 0
    # What the state folder knows is enough to be an operator, without the naming service.
    addresses = stop_addresses(guarded.state, RoleNaming.read(Path(operator)))
    uri = orb.uri_at(addresses.server, addresses.key("SimulationServer"))
    assert orb.reference(uri, RoboCorba.SimulationServer).stopRobots(["nobody"], "") == []
    uri = orb.uri_at(addresses.channels["a"], addresses.key("EventChannels/a"))
    assert orb.reference(uri, RoboCorba.EventChannel).supply("") is not None
    refused(found(orb, guarded, Role.ROBOT, "MapEditor")._narrow(RoboCorba.MapEditor).begin)
    found(orb, guarded, Role.OPERATOR, "MapEditor")._narrow(RoboCorba.MapEditor).begin().rollBack()


def test_names_return_after_a_kill_of_their_server(orb: Orb, guarded: Running) -> None:
    before = guarded.pid("names")
    os.kill(before, signal.SIGKILL)
    eventually(lambda: guarded.pid("names") not in (0, before), PATIENCE_S, "started again")
    planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner, timeout_s=PATIENCE_S)
    assert planner._get_mapVersion() >= 0
    eventually(lambda: "A" in orb.names("Robots", PATIENCE_S), PATIENCE_S, "the robot's name")


def test_a_robot_with_a_file_of_its_own_is_nobody_else(orb: Orb, guarded: Running, tmp_path: Path) -> None:
    with Launcher(tmp_path) as launch:
        out, _ = launch(ROBOCORBA, "access", "robot", "B/x", "--state", str(guarded.state)).communicate(
            timeout=PATIENCE_S
        )
        assert out == ""
        out, _ = launch(ROBOCORBA, "access", "robot", "B.1", "--state", str(guarded.state)).communicate(
            timeout=PATIENCE_S
        )
    file = Path(out.strip())
    assert (file.stat().st_mode & 0o777, file.parent) == (0o600, guarded.state / "access" / "robots")
    root = orb.reference(file.read_text().strip(), CosNaming.NamingContextExt, 10.0)

    def get(name: str, interface: Any) -> Any:
        return root.resolve_str(name)._unchecked_narrow(interface)

    def is_there() -> bool:
        names = ("SimulationServer", "OmniDatabase", "EventChannels/a")
        try:
            return not any(get(f"RoboCorba/{name}", CORBA.Object)._non_existent() for name in names)
        except (CORBA.OBJECT_NOT_EXIST, CosNaming.NamingContext.NotFound):  # servers still return their names
            return False

    eventually(is_there, PATIENCE_S, "the robot's right")
    registry = get("NameRegistry", RoboCorba.NameRegistry)
    own = [RoboCorba.RoleReference(RoboCorba.OBSERVER_ROLE, root)]
    refused(registry.announce, "RoboCorba/Robots/C", own, SECRET, by=RoboCorba.InvalidBinding)
    registry.announce("RoboCorba/Robots/B.1", own, SECRET)
    registry.withdraw("RoboCorba/Robots/B.1", SECRET)
    server = get("RoboCorba/SimulationServer", RoboCorba.SimulationServer)
    refused(server.registerRobot, about("C", 8.0, 8.0))
    refused(server.stopRobots, [], "")
    server.registerRobot(about("B.1", 8.0, 8.0)).deregister()
    database = get("RoboCorba/OmniDatabase", RoboCorba.OmniDatabase)
    for leader in ("C", "B.1"):
        content = MissionContent(kind="move_table", about="table", leader=leader, begun=1.0).encode()
        put = functools.partial(database.putMission, RoboCorba.MissionRecord("m", 0, content))
        assert put() if leader == "B.1" else not refused(put)
    channel = get("RoboCorba/EventChannels/a", RoboCorba.EventChannel)
    refused(channel.for_suppliers)
    refused(channel.supply, "C")
    proxy = channel.supply("B.1")
    header = RoboCorba.EventHeader("t", "C", "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK)
    refused(proxy.pushEvent, RoboCorba.Event(header, b""), by=RoboCorba.InvalidEvent)
    header.source = "B.1"
    proxy.pushEvent(RoboCorba.Event(header, b""))
    file.unlink()
    eventually(lambda: root._non_existent() and server._non_existent(), PATIENCE_S, "the end of the right")
