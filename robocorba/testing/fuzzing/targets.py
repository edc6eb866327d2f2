"""A running system whose every interface is called: its objects, and examples of arguments."""

from __future__ import annotations

import contextlib
import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import CosEventChannelAdmin
import CosEventComm
import msgpack
from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.maps import native
from robocorba.missions.messages import KINDS
from robocorba.missions.subplan import VERSION
from robocorba.names import CHANNELS, ROBOTS, SENSOR_TOKEN, SENSORS
from robocorba.simulation.sensor_admission import proof_of
from robocorba.stubs import RoboCorba, RoboCorba__POA, YeRTUnitMobility, _GlobalIDL
from robocorba.testing.actual_robot import StandIn, running_stand_in
from robocorba.testing.buildings import two_floors
from robocorba.testing.fuzzing.calls import Target
from robocorba.testing.fuzzing.operations import operations
from robocorba.testing.fuzzing.values import Seen
from robocorba.testing.heartbeats import heartbeats
from robocorba.testing.processes import Running, eventually, running_system
from robocorba.testing.simulation import CROSS, NO_MOUNT, about

#: Time limit for the start of a robot [s].
START_LIMIT_S = 180.0
#: Time limit for a place of a robot that is to log on; sessions that nobody uses expire after two seconds [s].
PLACE_LIMIT_S = 60.0
#: Robots of the system, and of these calls.
ROBOT, OTHER, OURS = "A", "B", "F"

ICONS: list[dict[str, Any]] = [
    {"icon": "mbase_path", "floor": "L1", "x": 3.0, "y": 3.0, "heading": 1.0, "speed": 0.5},
    {"icon": "mbase_to", "x": 3.0, "y": 2.0, "heading": 0.0, "speed": 0.3},
    {"icon": "mbase_by", "ahead": 0.2, "left": 0.1, "turn": 0.5, "speed": 0.3},
    {"icon": "mbase_velocity", "ahead": 0.1, "left": 0.0, "turn": 0.1, "seconds": 0.2},
    {"icon": "mhand_joints", "hand": "left", "joints": [0, 0, 0, 0.1, 0, 0, 0], "seconds": 0.5},
    {"icon": "mhand_pose", "hand": "right", "x": 0.4, "y": -0.2, "z": 0.8, "roll": 0, "pitch": 0, "yaw": 0},
    {"icon": "mhand_offset", "hand": "both", "dx": 0.01, "dy": 0.0, "dz": 0.01, "seconds": 0.1},
    {"icon": "mhand_posture", "hand": "both", "posture": "tuck"},
    {"icon": "lumbar", "lower": 0.0, "upper": 0.1, "seconds": 1},
    {"icon": "gripper", "hand": "left", "action": "close", "opening": 0.3, "force": 5, "object": "box"},
    {"icon": "wait_until", "condition": {"when": "closer_than", "sensor": "laser", "distance": 1.0}, "seconds": 0.1},
    {"icon": "wait_until", "condition": {"when": "event", "type": "a.*", "source": "*"}, "seconds": 0.1},
    {"icon": "stop_if_closer", "sensor": "front", "distance": 0.1, "icons": [{"icon": "wait", "seconds": 0.1}]},
    {"icon": "wait", "seconds": 0.1},
    {"icon": "repeat", "times": 2, "icons": [{"icon": "wait", "seconds": 0.01}]},
    {
        "icon": "branch",
        "condition": {"when": "holding", "hand": "left"},
        "then": [{"icon": "wait", "seconds": 0.1}],
        "otherwise": [{"icon": "wait", "seconds": 0.1}],
    },
    {"icon": "branch", "condition": {"when": "result", "result": "done"}, "then": []},
    {"icon": "say", "type": "robot.said", "payload": {"n": [1, 2.5, None, "text"]}},
]
MISSIONS: list[dict[str, Any]] = [
    {"icon": "move_table", "table": "table", "to": {"floor": "L1", "x": 6.0, "y": 6.0, "heading": 0.0}},
    {"icon": "hand_over", "object": "box", "taker": OTHER, "giver": ROBOT},
]
#: Members of the messages of missions.
MESSAGE = {
    "version": VERSION,
    "mission": "m.1",
    "sent": 1.0,
    "leader": OTHER,
    "robot": ROBOT,
    "floor": "L1",
    "x": 3.0,
    "y": 3.0,
    "helpers": 1,
    "heard": [],
    "busy": "",
    "phases": ["gather", "do"],
    "subplan": {"mission": "m.1", "robot": ROBOT, "role": "helper", "steps": []},
    "accepts": True,
    "reason": "",
    "step": 0,
    "at": 1.0,
    "along_s": 0.0,
    "rate": 1.0,
    "since": 1.0,
    "end": "",
}
TEXTS: tuple[str, ...] = (
    "L1",
    "L2",
    "E1",
    ROBOT,
    OTHER,
    OURS,
    "a",
    "b",
    "simulated",
    "room",
    "desk",
    "table",
    "box",
    "main",
    "s1",
    "w",
    "top",
    "bottom",
    "mission.order",
    "robot.state",
    "*",
    "Mobility",
    "MnpL",
    "GripperR",
    "simulation",
    "map_editor",
)


class _Consumer(RoboCorba__POA.EventConsumer):
    """A consumer that takes whatever arrives."""

    def push(self, data: Any) -> None:
        """Ignore an event."""

    def pushRuns(self, runs: Any) -> None:
        """Ignore events."""

    def pushTogether(self, which: int, events: Any) -> None:
        """Ignore events."""

    def disconnect_push_consumer(self) -> None:
        """Ignore the end."""


class FuzzedSystem:
    """The objects of a running system, by interface. Two channels, two robots, one sensor server, and a stand-in for an
    actual robot; a thread keeps the session of a third robot."""

    def __init__(self, running: Running, orb: Orb, stand_in: StandIn | None = None) -> None:
        self.running, self._orb, self._stand_in = running, orb, stand_in
        self.editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
        self.planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        self.server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
        self.database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
        self.control = orb.resolve("MissionControl", RoboCorba.MissionControl)
        self.supervisor = orb.reference((running.state / "supervisor.ior").read_text(), RoboCorba.Supervisor)
        self.sensor = orb.resolve(f"{SENSORS}/s1", RoboCorba.VirtualSensor)
        self.channel = orb.resolve(f"{CHANNELS}/a", RoboCorba.EventChannel)
        ior = (running.state / "administrator.ior").read_text()
        self.administrator = orb.reference(ior, RoboCorba.SimulationAdministrator)
        for number, name in enumerate((ROBOT, OTHER)):
            order = RoboCorba.RobotOrder(name, "simulated", [], "L1", True, 3.0 + 3 * number, 3.0, 0.0, "a")
            self.supervisor.startRobot(order)
        eventually(self._are_ready, START_LIMIT_S, "the robots")
        self.agent = orb.resolve(f"{ROBOTS}/{ROBOT}", RoboCorba.RobotAgent)
        self.consumer = orb.activate(_Consumer())
        dead = orb.reference("corbaloc::127.0.0.1:9/nobody", RoboCorba.EventConsumer)
        references = [self.consumer, dead, self.server, self.channel, self.sensor, self.agent]
        self.seen = Seen(TEXTS, references)
        self._numbers = itertools.count()
        self._session: Any = None
        self._heartbeats = heartbeats(lambda: filter(None, [self._session]))
        self.before = self.processes()

    def close(self) -> None:
        self._heartbeats.close()

    def processes(self) -> dict[str, tuple[int, int]]:
        """Process id and number of restarts of each process of the system."""
        found = {one.name: (one.processId, one.restarts) for one in self.supervisor.processes()}
        return {name: one for name, one in found.items() if not name.startswith("robot_") or name[6:] in (ROBOT, OTHER)}

    def ended(self) -> set[str]:
        """The processes that have another process id or more restarts than at the start, or are gone."""
        now = self.processes()
        return {name for name, one in self.before.items() if now.get(name) != one}

    def _are_ready(self) -> bool:
        robots = [one for one in self.supervisor.processes() if one.name.startswith("robot_")]
        return len(robots) == 2 and all(one.phase == RoboCorba.PROCESS_READY for one in robots)

    # ---- references ----

    def session(self) -> Any:
        """The session of our robot, a new one if it has ended."""
        try:
            self._session.heartbeat()
        except (AttributeError, CORBA.SystemException):
            self._session = self.new_session(OURS)
        return self._session

    def new_session(self, name: str = "") -> Any:
        """The session of a robot that logs on now, as soon as there is a place: earlier ones may have to expire."""
        name = name or f"f{next(self._numbers)}"
        places = [(x, y) for y in (8.0, 6.5, 1.5) for x in range(2, 16, 2)]

        def log_on() -> Any:
            for x, y in places:
                with contextlib.suppress(RoboCorba.PlaceTaken):
                    return self.server.registerRobot(about(name, float(x), y))
            return None

        return eventually(log_on, PLACE_LIMIT_S, "place for a robot")

    def registration(self) -> Any:
        """A registration of the sensor server under a second name."""
        token = (self.running.state / SENSOR_TOKEN).read_text().strip()
        proof = proof_of(token, "fuzz", self._orb.uri(self.sensor))
        return self.server.registerSensor("fuzz", self.sensor, proof)

    def by_key(self, key: str, interface: Any) -> Any:
        """An object of channel a by its key, such as feed."""
        endpoint = next(one.endpoint for one in self.running.record().processes if one.name == "events_a")
        return self._orb.reference(f"corbaloc:iiop:1.2@{endpoint}/{CHANNELS}/a/{key}", interface)

    def unit(self, name: str, interface: Any) -> Any:
        assert self._stand_in
        return self._stand_in.unit(name, interface)

    def proxy(self, kind: str, interface: Any) -> Any:
        """A fresh proxy of channel a."""
        admin = self.channel.for_suppliers() if kind.endswith("consumer") else self.channel.for_consumers()
        return getattr(admin, f"obtain_{kind}")()._narrow(interface)

    # ---- after calls ----

    def undo_edit(self, name: str, result: Any) -> None:
        """Undo edits, and end what was begun."""
        for one in result if isinstance(result, tuple) else (result,):
            if isinstance(one, RoboCorba._objref_Transaction):
                one.rollBack()
            elif isinstance(one, RoboCorba._objref_EditSession):
                one.close()
            elif name not in ("undo", "redo") and isinstance(one, int) and one > 1:
                with contextlib.suppress(RoboCorba.NothingToUndo):
                    self.editor.undo(self.editor._get_currentVersion())

    def end_robot(self, name: str, result: Any) -> None:
        """Log a robot off."""
        if name == "registerRobot" and result is not None:
            result.deregister()

    def end_processes(self, name: str, result: Any) -> None:
        """End robots that were started."""
        for one in self.supervisor.processes() if name == "startRobot" else ():
            if one.name.startswith("robot_") and one.name[6:] not in (ROBOT, OTHER):
                self.supervisor.endRobot(one.name[6:])

    def resume(self, name: str, result: Any) -> None:
        """Let the time of the simulation pass as before."""
        self.administrator.resume()
        self.administrator.setPace(1.0)
        self.administrator.setLimit(200)

    def end_proxy(self, name: str, result: Any) -> None:
        """Disconnect proxies, and remove peers that were added."""
        if name == "addPeer" or name == "joinGateway":
            for peer in self.channel.peers():
                if peer.name != "b":
                    self.channel.removePeer(peer.name)
        if name == "removePeer":
            self.channel.addPeer(RoboCorba.PeerAddress("b", "", False))
        for one in result if isinstance(result, tuple) else (result,):
            for end in ("push_supplier", "pull_supplier", "push_consumer", "pull_consumer"):
                if hasattr(one, f"disconnect_{end}"):
                    getattr(one, f"disconnect_{end}")()

    def no_faults(self, name: str, result: Any) -> None:
        """Switch the faults of the stand-in off."""
        assert self._stand_in
        self._stand_in.faults.none()

    # ---- all of them ----

    def targets(self) -> list[Target]:
        """The objects of all interfaces."""
        return [
            *self._of_the_map(),
            *self._of_the_simulation(),
            *self._of_the_channel(),
            *self._of_robots(),
            *self._of_units(),
        ]

    def _of_the_map(self) -> Iterator[Target]:
        elements = [
            each
            for kind in RoboCorba.ElementKind._items
            for floor in ("", "L1", "L2")
            for each in self._elements(kind, floor)
        ]
        edits = {
            "create": [_each(each.onFloor, _renamed(each.value)) for each in elements],
            "change": [_each(each.onFloor, each.value, each.changedAt) for each in elements],
            "remove": [_each(_id(each), each.changedAt) for each in elements],
            "rename": [_each(_id(each), "renamed", each.changedAt) for each in elements],
        }
        document = self.editor.exportMap()
        version = self.editor._get_currentVersion
        on_editor = {
            **edits,
            "importMap": [lambda: (document, version())],
            "elements": [_each(each.value._d, each.onFloor) for each in elements],
            "read": [_each(_id(each)) for each in elements],
            "buildTopologicalMap": [_each("L1", 0.4)],
            "checkFloor": [_each("L1", 0.4)],
            "changesSince": [lambda: (max(0, version() - 3),)],
            "editsSince": [lambda: (max(0, version() - 3),)],
            "undo": [lambda: (version(),)],
            "redo": [lambda: (version(),)],
            "getUnderlay": [_each("L1")],
            "setUnderlay": [_each("L1", RoboCorba.Underlay(_PNG, RoboCorba.XY(0.0, 0.0), 0.05))],
            "openSession": [_each("author")],
        }
        end = self.undo_edit
        yield Target("MapEditor", RoboCorba.MapEditor, lambda: self.editor, on_editor, end)
        session = [self.editor.openSession("fuzz")]

        def open_session() -> Any:
            try:
                session[0]._get_author()
            except CORBA.OBJECT_NOT_EXIST:
                session[0] = self.editor.openSession("fuzz")
            return session[0]

        yield Target("EditSession", RoboCorba.EditSession, open_session, edits, end, frozenset({"close"}))
        ends = frozenset({"commit", "rollBack"})
        transaction: list[Any] = []

        def begin() -> Any:
            for one in transaction:
                with contextlib.suppress(CORBA.Exception):
                    one.rollBack()
            transaction[:] = [self.editor.begin()]
            return transaction[0]

        yield Target("Transaction", RoboCorba.Transaction, begin, edits, end, ends)
        start, goal = RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L2", 3.0, 3.0)
        request = self.planner.defaultRequest(start, RoboCorba.Point("L1", 15.0, 3.0))
        on_planner = {
            "getPath": [_each(start, goal)],
            "findPaths": [_each(request)],
            "defaultRequest": [_each(start, goal)],
        }
        also = dict.fromkeys(("getPath", "findPaths"), (CORBA.TIMEOUT,))
        yield Target("PathPlanner", RoboCorba.PathPlanner, lambda: self.planner, on_planner, also=also)

    def _elements(self, kind: Any, floor: str) -> Sequence[Any]:
        try:
            found: Sequence[Any] = self.editor.elements(kind, floor)
        except RoboCorba.UnknownElement:
            return ()
        return found

    def _of_the_simulation(self) -> Iterator[Target]:
        square = [RoboCorba.XY(1.0, 1.0), RoboCorba.XY(2.0, 1.0), RoboCorba.XY(2.0, 2.0)]
        areas = [RoboCorba.FloorArea("L1", square)]
        pose = RoboCorba.Pose("L1", 5.0, 5.0, 0.0)
        on_session = {
            "command": [_each(RoboCorba.Velocity(0.1, 0.0, 0.1), 0.2)],
            "grip": [_each("box", RoboCorba.XY(2.0, 2.0))],
            "callElevator": [_each("E1", "L2")],
            "callElevatorTogether": [_each("E1", "L2", "party", 2)],
            "callElevatorFor": [_each("E1", "L2", "party", 2, 20.0)],
            "reserveAreas": [_each(areas, 5.0)],
            "reserveOneOf": [_each([areas, areas], 5.0)],
            "exchangeAreas": [_each(areas, 5.0)],
            "takeOverAreas": [_each(OTHER)],
            "keepAreas": [_each(areas)],
            "reportPosture": [_each([0.1] * 18)],
        }
        yield Target(
            "RobotSession", RoboCorba.RobotSession, self.session, on_session, omitted=frozenset({"deregister"})
        )
        yield Target(
            "RobotSession, ended",
            RoboCorba.RobotSession,
            self.new_session,
            ends=frozenset({"deregister"}),
            omitted=frozenset(one.name for one in operations(RoboCorba.RobotSession) if one.name != "deregister"),
        )
        load = RoboCorba.SensorLoad(0.1, 0.1, 10.0, 1)
        scan = RoboCorba.ScanData(1.0, 0.0, 0.1, [1.0, 2.0, 3.0, 4.0])
        data = RoboCorba.SensorData(ROBOT, pose, scan)
        whole = RoboCorba.RobotScan(ROBOT, pose, NO_MOUNT, CROSS, scan, bytes(4))
        on_server = {
            "registerRobot": [lambda: (about(f"f{next(self._numbers)}", 8.0, 8.0),)],
            "renderFloor": [_each("L1", 200)],
            "reportSensor": [_each("fake", self.sensor, load, [data]), _each("fake", None, load, [])],
            "reportScans": [_each("s1", [whole])],
        }
        yield Target("SimulationServer", RoboCorba.SimulationServer, lambda: self.server, on_server, self.end_robot)
        on_registration = {"report": [_each(load, [data])], "reportScans": [_each([whole])]}
        yield Target("SensorRegistration", RoboCorba.SensorRegistration, self.registration, on_registration)
        on_administrator = {
            "place": [_each(OTHER, pose)],
            "evict": [_each("nobody")],
            "setPace": [_each(1.0)],
            "setLimit": [_each(200)],
            "step": [_each(1)],
        }
        administrator = _same(self.administrator)
        yield Target(
            "SimulationAdministrator", RoboCorba.SimulationAdministrator, administrator, on_administrator, self.resume
        )
        record = RoboCorba.MissionRecord("m", 0, b"document")
        on_database = {
            "getFloor": [_each("L1")],
            "floorChanges": [_each("L1", 1)],
            "putMission": [_each(record), _each(_stored_mission())],
            "removeMission": [_each("m")],
            "lastScans": [_each("L1")],
            "scansSince": [_each("L1", 0.0)],
            "postures": [_each("L1", 0.0)],
        }
        yield Target("OmniDatabase", RoboCorba.OmniDatabase, lambda: self.database, on_database, self.end_missions)
        on_control = {
            "start": [_each(OTHER, json.dumps(icon)) for icon in MISSIONS],
            "missionsSince": [_each(0)],
            "mission": [_each("m")],
            "report": [_each("m")],
            "abort": [_each("m")],
        }
        yield Target("MissionControl", RoboCorba.MissionControl, lambda: self.control, on_control, self.end_missions)
        on_sensor = {"scan": [_each(pose, NO_MOUNT, CROSS)], "scanMany": [_each([pose, pose], NO_MOUNT, CROSS)]}
        yield Target("VirtualSensor", RoboCorba.VirtualSensor, lambda: self.sensor, on_sensor)
        own = {**on_sensor, "forRobot": [_each(OURS)]}
        yield Target("VirtualSensor of a robot", RoboCorba.VirtualSensor, lambda: self.session()._get_sensor(), own)

    def end_missions(self, name: str, result: Any) -> None:
        """Remove the missions that a call may have stored."""
        for mission in self.database.missions() if name in ("putMission", "start") else ():
            with contextlib.suppress(CORBA.UserException):
                self.database.removeMission(mission.name)

    def _of_the_channel(self) -> Iterator[Target]:
        header = RoboCorba.EventHeader("robot.state", ROBOT, "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK)
        payloads: list[Any] = [MESSAGE, {**MESSAGE, "x": "nan"}, {"version": VERSION}, [], {**MESSAGE, "step": -5}]
        events = [
            RoboCorba.Event(_typed(header, type, OTHER), msgpack.packb(payload))
            for type in KINDS
            for payload in payloads
        ]
        events += [RoboCorba.Event(_typed(header, "floor.changed", "L1"), msgpack.packb({"since": 1}))]
        runs = [RoboCorba.EventRun(header, [0.0, 1.0], [b"\xc0", b"\x01"])]
        pattern = RoboCorba.EventPattern("*", "*")
        subscription = [RoboCorba.Clause([pattern], 0.0), RoboCorba.Clause([pattern, pattern], 1.0)]
        queue = RoboCorba.QueuePolicy(100, RoboCorba.DISCARD_OLDEST, 0.0)
        on_proxies = {
            "push": [_each(CORBA.Any(RoboCorba._tc_Event, each)) for each in events],
            "pushEvent": [_each(each) for each in events],
            "pushRuns": [_each(runs)],
            "connect_push_supplier": [_each(None)],
            "connect_pull_consumer": [_each(None)],
            "connect_push_consumer": [_each(self.consumer)],
            "changeSubscription": [_each(subscription)],
            "isInForceAt": [_each("b")],
        }
        runs_from = [RoboCorba.EventRun(_typed(header, "x", "y", "b"), [1.0], [b"\xc0"])]
        gateway = self.by_key("gateway", RoboCorba.EventGateway)
        on_channel = {
            "supply": [_each("fuzz")],
            "subscribe": [_each("", self.consumer, subscription, queue), _each("kept", self.consumer, [], queue)],
            "unsubscribe": [_each("kept")],
            "addPeer": [_each(RoboCorba.PeerAddress("c", "127.0.0.1:9", False))],
            "removePeer": [_each("b")],
            "joinGateway": [_each("c", self.channel, gateway)],
            **on_proxies,
        }
        destroyed, end = frozenset({"destroy"}), self.end_proxy
        for interface in (RoboCorba.EventChannel, CosEventChannelAdmin.EventChannel):
            reference = self.channel._unchecked_narrow(interface)
            yield Target(_title(interface), interface, _same(reference), on_channel, end, omitted=destroyed)
        for key, interface in (
            ("consumers", CosEventChannelAdmin.ConsumerAdmin),
            ("suppliers", CosEventChannelAdmin.SupplierAdmin),
        ):
            yield Target(_title(interface), interface, _same(self.by_key(key, interface)), {}, end)
        disconnections = frozenset(f"disconnect_{kind}" for kind in _PROXIES)
        blocked = frozenset({"pull"})
        for kind, proxy, base, own in (
            ("push_consumer", RoboCorba.EventProxyPushConsumer, CosEventChannelAdmin.ProxyPushConsumer, "PushConsumer"),
            ("push_supplier", RoboCorba.EventProxyPushSupplier, CosEventChannelAdmin.ProxyPushSupplier, "PushSupplier"),
            ("pull_supplier", RoboCorba.EventProxyPullSupplier, CosEventChannelAdmin.ProxyPullSupplier, "PullSupplier"),
            ("pull_consumer", None, CosEventChannelAdmin.ProxyPullConsumer, "PullConsumer"),
        ):
            for interface in filter(None, (proxy, base, getattr(CosEventComm, own))):
                make = self._kept_proxy(kind, interface)
                also = {"": (CosEventComm.Disconnected,)}
                yield Target(
                    _title(interface),
                    interface,
                    make,
                    on_proxies,
                    ends=disconnections,
                    also=also,
                    omitted=blocked,
                )
        join = {
            "forward": [_each("session", 1, runs_from)],
            "acknowledge": [_each("session", 1)],
            "renew": [_each("session", 1, [RoboCorba.ChannelNotice("c", 1, ["a"], [pattern])])],
            "leave": [_each("session")],
        }
        yield Target("EventGateway", RoboCorba.EventGateway, _same(gateway), join)
        feed = self.by_key("feed", RoboCorba.GatewayFeed)
        yield Target("GatewayFeed", RoboCorba.GatewayFeed, _same(feed), join)

    def _kept_proxy(self, kind: str, interface: Any) -> Callable[[], Any]:
        """A maker of connected proxies that disconnects the one before."""
        before: list[Any] = []

        def make() -> Any:
            for one in before:
                with contextlib.suppress(CORBA.Exception):
                    getattr(one, f"disconnect_{kind}")()
            one = self.proxy(kind, interface)
            before[:] = [one]
            return one

        return make

    def _of_robots(self) -> Iterator[Target]:
        programs = [{"format": 1, "name": "p", "icons": [icon]} for icon in (*ICONS, *MISSIONS)]
        programs.append({"format": 1, "name": "all", "robot": "SmartPal", "icons": ICONS})
        documents = [_each(json.dumps(program)) for program in programs]
        on_agent = {
            "loadProgram": documents,
            "checkProgram": documents,
            "startMission": [_each("m", json.dumps(icon)) for icon in MISSIONS],
            "abortMission": [_each("m")],
            "iconsFrom": [_each(0)],
            "setSpeedCap": [_each(0.5)],
            "drive": [_each(RoboCorba.Velocity(0.05, 0.0, 0.1), 0.2)],
            "switchAdaptor": [_each("simulated", [])],
            "run": [_each(False)],
        }

        def reset(name: str, result: Any) -> None:
            if name in ("run", "startMission", "step", "resume", "drive"):
                self.agent.abort()
            if name == "stop":
                self.agent.resetStop()

        yield Target("RobotAgent", RoboCorba.RobotAgent, lambda: self.agent, on_agent, reset)
        pool = self.agent._get_pool()
        on_pool = {"changes": [_each(1)], "postures": [_each(0.0)], "plan": [_each("m")]}
        yield Target("DataPool", RoboCorba.DataPool, _same(pool), on_pool)
        order = RoboCorba.RobotOrder("C", "simulated", [], "L1", True, 9.0, 3.0, 0.0, "a")
        on_supervisor = {
            "startRobot": [_each(_with(order, adaptor="none")), _each(_with(order, channel="none"))],
            "endRobot": [_each("nobody")],
            "logLines": [_each(name, 10) for name in ("simulation", "up", "events_a")],
        }
        yield Target(
            "Supervisor",
            RoboCorba.Supervisor,
            lambda: self.supervisor,
            on_supervisor,
            self.end_processes,
            unseen=frozenset({"endRobot"}),
        )

    def _of_units(self) -> Iterator[Target]:
        if self._stand_in is None:
            return
        lost = {"": (CORBA.COMM_FAILURE,)}
        for name, interface in (
            ("Mobility", YeRTUnitMobility.mobility),
            ("MnpL", _GlobalIDL.ArmUnit),
            ("GripperL", _GlobalIDL.GripperUnit),
            ("GripperR", _GlobalIDL.GripperExtAxes),
            ("Lumbar", _GlobalIDL.LumbarUnit),
            ("Lumbar", _GlobalIDL.LumbaExtAxes),
        ):
            bound = "Mobility.Unit" if name == "Mobility" else name
            yield Target(_title(interface), interface, _same(self.unit(bound, interface)))
        faults = {
            "alarm": [_each("Mobility", 1, _GlobalIDL.FAULT, "a fault")],
            "stuck": [_each("MnpL", True)],
            "lost": [_each("MnpL", True)],
            "slowNetwork": [_each(0.01)],
        }
        yield Target(
            "SmartPalFaults",
            RoboCorba.SmartPalFaults,
            _same(self._stand_in.faults),
            faults,
            self.no_faults,
            also=lost,
        )


#: Interfaces that clients implement, not servers of this system; RobotAdaptor is for agents in other processes.
OF_CLIENTS = (RoboCorba.EventConsumer, RoboCorba.IdempotentEventConsumer, RoboCorba.RobotAdaptor)
#: Those whose references servers keep for themselves, and those that need --guarded or clients behind NAT.
OUT_OF_REACH = (RoboCorba.StopTarget, RoboCorba.NameRegistry, RoboCorba.CallbackRoute)
_PROXIES = ("push_supplier", "pull_supplier", "push_consumer", "pull_consumer")
#: A picture of one pixel.
_PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010806000000"
    "1f15c4890000000d49444154789c63f8cfc0f01f00050001ff56c7a3d80000000049454e44ae426082"
)


def _each(*arguments: Any) -> Callable[[], tuple[Any, ...]]:
    return lambda: arguments


def _same(reference: Any) -> Callable[[], Any]:
    return lambda: reference


def _title(interface: Any) -> str:
    return str(interface._NP_RepositoryId.split(":")[1]).removeprefix("RoboCorba/").removeprefix("omg.org/")


def _id(record: Any) -> Any:
    return RoboCorba.ElementId(record.value._d, record.onFloor, record.value._v.name)


def _with(struct: Any, **members: Any) -> Any:
    return type(struct)(*(members.get(name, value) for name, value in vars(struct).items()))


def _renamed(element: Any) -> Any:
    return RoboCorba.Element(element._d, _with(element._v, name="new"))


def _typed(header: Any, type: str, source: str, origin: str = "") -> Any:
    return _with(header, type=type, source=source, origin=origin, number=1 if origin else 0)


def _stored_mission() -> Any:
    document = {"version": VERSION, "kind": "move_table", "leader": OTHER, "result": "running", "begun": 1.0}
    return RoboCorba.MissionRecord("stored", 0, msgpack.packb(document))


@contextlib.contextmanager
def fuzzed_system(folder: Path) -> Iterator[FuzzedSystem]:
    """A system whose logs are in folder/state/logs, until the end of the `with`."""
    native.save(two_floors(), folder / "two-floors.yaml")
    with (
        running_system(folder, "--building", "two-floors.yaml", "--subnets", "a,b", "--hang-limit", "0") as (
            running,
            _,
        ),
        Orb(running.naming, call_timeout_s=30.0) as orb,
        running_stand_in(folder / "actual", orb=orb) as stand_in,
        contextlib.closing(FuzzedSystem(running, orb, stand_in)) as system,
    ):
        yield system
