"""A guarded system to be attacked: its secrets, its state before and after, and forgeries that a robot may try."""

from __future__ import annotations

import contextlib
import functools
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import CosNaming
import msgpack
from omniORB import CORBA

from robocorba.map_editor import native
from robocorba.orb.guard import guarded
from robocorba.orb.ior import address_of
from robocorba.orb.orb import CONTEXT, Orb
from robocorba.simulation.mission_record import MissionContent
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.names import ROBOTS, STOP_EVENT
from robocorba.system.roles import Role
from robocorba.system.settings import RoleNaming, role_file
from robocorba.system.supervision.access import Access
from testkit.buildings import two_floors
from testkit.fuzzing.examples import OTHER
from testkit.fuzzing.fuzzed_system import FuzzedSystem
from testkit.fuzzing.simulation_targets import end_missions
from testkit.fuzzing.targets import targets
from testkit.intrusion.intruder import OBJECTS, OURS, THEIRS, Intruder
from testkit.processes import Running, command_line, eventually, running_system
from testkit.simulation import about

#: Who attacks: a stranger knows HOST:PORT and the open keys, the others have the file of their role, the last one that
#: of a single robot.
STRANGER, OBSERVER, ROBOT, ONE_ROBOT = "stranger", "observer", "robot", "robot with its own file"
ROLES = {STRANGER: Role.OBSERVER, OBSERVER: Role.OBSERVER, ROBOT: Role.ROBOT, ONE_ROBOT: Role.ROBOT}
#: The key of another guarded system, which the address of a peer contains, and the name of that peer.
FOREIGN_KEY, FOREIGN = "5ec2e7" * 10 + "5ec2", "elsewhere"
SECRET = "a secret of the intruder"


class _Adaptor(RoboCorba__POA.RobotAdaptor):
    """An adaptor of a robot that does nothing."""

    def start(self, arguments: list[str]) -> bool:
        return True

    stop = read = write = lambda self, *arguments: True


class GuardedSystem:
    """orb: of this process, which has the rights of the servers."""

    def __init__(self, running: Running, orb: Orb, fuzzed: FuzzedSystem) -> None:
        self.running, self.orb, self.fuzzed = running, orb, fuzzed
        address = f"corbaname::127.0.0.1:9/access/server/{FOREIGN_KEY}#{CONTEXT}/EventChannels/{FOREIGN}"
        fuzzed.channel.addPeer(RoboCorba.PeerAddress(FOREIGN, address, False))
        everything = targets(fuzzed)
        self.examples = {target.name: target.examples for target in everything}
        self.examples |= {target.interface.__name__: target.examples for target in everything}
        self.endpoints = {
            name.removeprefix(f"{CONTEXT}/"): process.endpoint
            for process in running.record().processes
            for name in process.names
            if process.endpoint
        }
        robot = address_of(orb.uri(fuzzed.agent))
        self.endpoints[f"{ROBOTS}/{THEIRS}"] = str(robot)
        self._one = Access.read(running.state).robot(OURS)
        eventually(self._is_one_there, what="the right of the robot with its own file")

    def intruder(self, who: str) -> Intruder:
        role = ROLES[who]
        consumer, is_one = self.fuzzed.consumer, who == ONE_ROBOT
        return Intruder(self.orb, role, self.root(who), consumer, self.examples, self.secrets(who), is_one)

    def _is_one_there(self) -> bool:
        try:
            root = self.root(ONE_ROBOT)
            return not any(root.resolve_str(f"{CONTEXT}/{name}")._non_existent() for name in OBJECTS)
        except CORBA.OBJECT_NOT_EXIST:
            return False

    def named(self, who: str, intruder: Intruder) -> dict[str, Any]:
        """The objects with a name, by interface, as they find them; and an adaptor of this process."""
        found = intruder.by_open_key(self.endpoints) if who == STRANGER else intruder.by_name
        return {**found, "RobotAdaptor": self.orb.activate(guarded(_Adaptor(), ROLES[who]))}

    def root(self, who: str) -> Any:
        """The naming context that they know."""
        uri = f"corbaloc:iiop:1.2@{self.running.naming}/NameService"
        if who != STRANGER:
            file = self._one if who == ONE_ROBOT else role_file(self.running.state, ROLES[who])
            uri = file.read_text().strip()
        return self.orb.reference(uri, CosNaming.NamingContextExt, 10.0)

    def own_key(self, who: str) -> str:
        if who == ONE_ROBOT:
            return RoleNaming.read(self._one).key
        return Access.read(self.running.state).key(Role.ROBOT) if who == ROBOT else ""

    @property
    def open_keys(self) -> list[str]:
        """Keys at which everybody finds what observers may call."""
        contexts = ("", f"/{CONTEXT}", *(f"/{CONTEXT}/{each}" for each in (ROBOTS, "EventChannels", "VirtualSensors")))
        return [*self.endpoints, *(f"NameService{each}" for each in contexts)]

    def secrets(self, who: str = "") -> dict[str, str]:
        """What nobody else may learn, by where it is."""
        state = self.running.state
        keys = {f"access/{name}.ior": key for name, key in Access.read(state).keys.items() if name != who}
        keys.pop("access/observer.ior", None)  # not a secret
        files = {name: (state / name).read_text() for name in ("administrator.ior", "supervisor.ior", "sensors.token")}
        held = re.findall(r"stop/[\w-]{20,}", (state / "stops.json").read_text())
        stops = {"stops.json": held[0]} if held else {}
        return {**keys, **files, **stops, "the key of another system": FOREIGN_KEY}

    def command_lines(self) -> str:
        """What other users of the machine see of the processes."""
        return "\n".join(map(command_line, self.running.note_descendants()))

    def state(self) -> dict[str, Any]:
        """What an attack must leave as it was."""
        fuzzed = self.fuzzed
        agents = [self.orb.resolve(f"{ROBOTS}/{name}", RoboCorba.RobotAgent) for name in (THEIRS, OTHER)]
        states = [agent._get_state() for agent in agents]
        server = fuzzed.server._get_state()
        names = {name: self.orb.uri(self.orb.resolve(name, CORBA.Object)) for name in OBJECTS}
        return {
            "map": fuzzed.editor._get_currentVersion(),
            "names": names,
            "peers": sorted(peer.name for peer in fuzzed.channel.peers()),
            "missions": [(one.name, one.current) for one in fuzzed.database.missions()],
            "robots": [(one.condition, one.adaptor, one.speedCap, one.at.floor) for one in states],
            "simulation": (server.limit, server.pace, server.paused),
            "sensors": [one.name for one in fuzzed.server.sensors()],
            "ended": sorted(fuzzed.ended()),
        }


class Forgery(NamedTuple):
    """who: the robot. what: the attempt. is_possible: whether docs/operations.md says that it can do it. refusal: the
    exception, empty if it succeeded."""

    who: str
    what: str
    is_possible: bool
    refusal: str

    @property
    def is_as_documented(self) -> bool:
        return self.is_possible != bool(self.refusal)


def forgeries(system: GuardedSystem, who: str) -> Iterator[Forgery]:
    """What a robot may try in the names of others. who: ROBOT, which can do some of it, or ONE_ROBOT."""
    fuzzed, root, can = system.fuzzed, system.root(who), who == ROBOT

    def found(name: str, interface: Any) -> Any:
        return root.resolve_str(f"{CONTEXT}/{name}")._unchecked_narrow(interface)

    registry = root.resolve_str("NameRegistry")._narrow(RoboCorba.NameRegistry)
    server = found("SimulationServer", RoboCorba.SimulationServer)
    channel = found("EventChannels/a", RoboCorba.EventChannel)
    database = found("OmniDatabase", RoboCorba.OmniDatabase)
    false = [RoboCorba.RoleReference(RoboCorba.OPERATOR_ROLE, fuzzed.consumer)]
    load = RoboCorba.SensorLoad(0.0, 0.0, 0.0, 0)
    header = RoboCorba.EventHeader("intruder.forged", THEIRS, "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK)

    def try_one(what: str, is_possible: bool, attempt: Callable[[], Any]) -> Forgery:
        refusal = ""
        try:
            attempt()
        except CORBA.Exception as error:
            refusal = type(error).__name__
        return Forgery(who, what, is_possible, refusal)

    path = f"{CONTEXT}/{ROBOTS}/{THEIRS}"
    yield try_one("announce the name of a robot", False, lambda: registry.announce(path, false, SECRET))
    yield try_one("withdraw the name of a robot", False, lambda: registry.withdraw(path, SECRET))
    for name in ("SimulationServer", "VirtualSensors/s2", "EventChannels/c", "Adaptors/x"):
        name = f"{CONTEXT}/{name}"
        yield try_one(f"announce {name}", False, functools.partial(registry.announce, name, false, SECRET))
    yield try_one("announce another free name", can, lambda: registry.announce(f"{path}2", false, SECRET))
    registry.withdraw(f"{path}2", SECRET)
    yield try_one("register under a taken name", False, lambda: server.registerRobot(about(THEIRS, 8.0, 8.0)))
    sensor = fuzzed.sensor
    yield try_one("register a false sensor", False, lambda: server.registerSensor("s1", sensor, "0" * 64))
    yield try_one("report as a sensor server", False, lambda: server.reportSensor("s1", sensor, load, []))
    yield try_one("report scans as a sensor server", False, lambda: server.reportScans("s1", []))
    session = server.registerRobot(about(OURS, 8.0, 8.0))
    own = session._get_sensor()
    yield try_one("get the sensor of another robot", False, lambda: own.forRobot(THEIRS))
    yield try_one("dismiss the sensor of another robot", False, lambda: own.dismiss(THEIRS))
    session.deregister()
    yield try_one("stop all robots", False, lambda: server.stopRobots([], "a forgery"))
    policy = RoboCorba.QueuePolicy(10, RoboCorba.DISCARD_OLDEST, 0.0)
    yield try_one(
        "take over a durable subscription", False, lambda: channel.subscribe("kept", fuzzed.consumer, [], policy)
    )
    event = RoboCorba.Event(header, b"\xc0")
    own_proxy = channel.supply(OURS)
    stop = RoboCorba.Event(
        RoboCorba.EventHeader(STOP_EVENT, OURS, "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK),
        msgpack.packb({"robots": ["nobody"], "reason": "a forgery"}),
    )
    yield try_one("publish an emergency stop", can, lambda: own_proxy.pushEvent(stop))
    yield try_one("publish in the name of a robot", can, lambda: own_proxy.pushEvent(event))
    yield try_one("end the supplier's proxy of a robot", can, lambda: channel.supply(THEIRS).disconnect_push_consumer())
    theirs, ours = (
        MissionContent(kind="move_table", about="table", leader=leader, begun=1.0).encode() for leader in (THEIRS, OURS)
    )
    record = RoboCorba.MissionRecord("led by another", 0, theirs)
    yield try_one("store a mission in the name of another leader", can, lambda: database.putMission(record))
    end_missions(fuzzed, "putMission", None)
    version = fuzzed.database.putMission(RoboCorba.MissionRecord("forged", 0, theirs))
    again = RoboCorba.MissionRecord("forged", version, ours)
    yield try_one("replace the record of a mission", can, lambda: database.putMission(again))
    yield try_one("remove the record of a mission", False, lambda: database.removeMission("forged"))
    fuzzed.database.removeMission("forged")


@contextlib.contextmanager
def guarded_system(folder: Path) -> Iterator[GuardedSystem]:
    """A guarded system with two channels and two robots, in folder/state."""
    native.save(two_floors(), folder / "two-floors.yaml")
    options = ("--building", "two-floors.yaml", "--subnets", "a,b", "--guarded", "--bidirectional", "--hang-limit", "0")
    with (
        running_system(folder, *options) as (running, _),
        Orb(RoleNaming.read(role_file(running.state, Role.SERVER)), call_timeout_s=30.0) as orb,
        contextlib.closing(FuzzedSystem(running, orb)) as fuzzed,
    ):
        eventually(lambda: len(orb.names(ROBOTS)) == 2, what="the names of the robots")
        yield GuardedSystem(running, orb, fuzzed)
