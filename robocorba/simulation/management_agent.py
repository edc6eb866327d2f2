"""The communication management agent: robots log on and off and get a sensor server; simulated time runs."""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable, Iterable

import msgspec

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import InvalidChoice, SessionExpired, SimulationError, UnknownRobot
from robocorba.map_editor.lineage import SAME_NAMES, Lineage
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation import omni_database, physics
from robocorba.simulation.attended_time import AttendedTime
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.load_balance import LoadBalance
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.simulation.record_names import with_present_names
from robocorba.simulation.registry import Description, Registry, RobotClient, ServerState, name_fault
from robocorba.simulation.robot_scans import LastScan, RobotScan
from robocorba.simulation.session import Session
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.simulation_loop import SimulationLoop, check_pace
from robocorba.simulation.state_writer import StateWriter
from robocorba.simulation.store import AdministratorSettings, ClientRecord, SimulationStore
from robocorba.simulation.world_record import WorldRecord

#: Default maximum number of logged-on robots.
DEFAULT_LIMIT = 300
#: Highest limit that an administrator may set.
MAX_ROBOTS = 10_000
#: Maximum number of names that an administrator keeps out.
MAX_KEPT_OUT = 1000

_log = logging.getLogger(__name__)


class ManagementAgent:
    """The paper's communication management agent: it owns the simulated building, its time, the robots' sessions and
    their records. It is restored from `store`, or started from the map if there is no record.

    publish: called with each event in the simulation thread; must not block. session_began: called in that thread
    with each new session before its robot can use it, but not with restored ones. session_ended: called with each ended
    session. lineage_since: says which elements of the map are those of an earlier version. After `start`, everything is
    thread-safe except `step`. Leases run from `begin_leases` on."""

    def __init__(
        self,
        edited_map: Building,
        map_version: int,
        store: SimulationStore,
        publish: Callable[[SimulationEvent], None] = lambda event: None,
        session_began: Callable[[Session], None] = lambda session: None,
        session_ended: Callable[[Session], None] = lambda session: None,
        lineage_since: Callable[[int], Lineage] = lambda version: SAME_NAMES,
    ) -> None:
        self._store, self._publish = store, publish
        self._session_began, self._session_ended = session_began, session_ended
        settings = store.settings() or AdministratorSettings(DEFAULT_LIMIT)
        self._lease_time = AttendedTime()
        self.registry = Registry(settings.limit, self._lease_time)
        self.registry.kept_out |= store.kept_out()
        #: Held while an administrator's order is carried out and stored.
        self._administering = threading.Lock()
        self.simulated = SimulatedBuilding(edited_map)
        self.database = OmniDatabase(self.simulated)
        self.database.map_version = map_version
        self.load_balance = LoadBalance(self._lease_time)
        self.loop = SimulationLoop(self.step, self._housekeeping)
        self.loop.configure(settings.pace, settings.paused)
        self.sessions: dict[str, Session] = {}
        self.collisions = 0
        self._event_count = self._counted_events = 0
        self._counted_at = self._written_at = self._checked_at = time.monotonic()
        self._event_rate = 0.0
        self._writer = StateWriter(store)
        self._are_leases_running = False
        self._restore(lineage_since)

    def start(self) -> None:
        """Start simulated time and the writer."""
        physics.warm_up()
        omni_database.warm_up()
        self._writer.start()
        self.loop.start()

    def close(self) -> None:
        """Stop simulated time, and save the final state."""
        self.loop.close()
        self._writer.close()
        with contextlib.suppress(ServiceError):
            self._store.save_world(self._record())

    def begin_leases(self) -> None:
        """Start the leases once calls are accepted: restored robots get a full lease from now on."""

        def begin() -> None:
            for client in self.registry.clients:
                client.last_call_at = self._lease_time()
            self._are_leases_running = True

        self.loop.do(begin)

    # ---- robots ----

    def register(self, description: Description) -> Session:
        """Log a robot on. Raises InvalidDescription, NameTaken, ServerFull, UnknownFloor, PlaceTaken, SimulationBusy,
        ServiceError."""
        session = self.loop.do(lambda: self._log_on(description))
        try:
            self._store.save_client(ClientRecord.of(session.client.key, session.client.since, description))
        except ServiceError:
            self.loop.do(lambda: self._log_off(session.client))
            raise
        return session

    def record_scans(self, latest: Iterable[LastScan]) -> None:
        """Record the robots' last scans; a scan renews its robot's lease.

        Scans of an earlier robot of the same name may arrive late, by another sensor server; they are ignored."""
        began = self._session_starts()
        for scan in latest:
            if scan.time >= began.get(scan.robot, math.inf):
                with contextlib.suppress(UnknownRobot, SessionExpired):
                    self.registry.find(scan.robot).renew_lease()
                    self.database.record_scan(scan)

    def record_robot_scans(self, latest: Iterable[RobotScan]) -> float:
        """Record complete scans of logged-on robots; return the seconds until the next ones are wanted.

        Scans of an earlier robot of the same name may arrive late; they are ignored."""
        began = self._session_starts()
        scans = self.database.robot_scans
        for scan in latest:
            if scan.time >= began.get(scan.robot, math.inf):
                scans.record(scan)
        scans.keep({client.name for client in self.registry.clients})  # some may have logged off meanwhile
        return scans.interval_s

    def _session_starts(self) -> dict[str, float]:
        """Simulated time at which each robot logged on [s]."""
        return {session.name: session.began for session in list(self.sessions.values())}

    def evict(self, name: str) -> None:
        """Log a robot off. Raises UnknownRobot, SimulationBusy, ServiceError."""
        self._log_off_durably(self.registry.find(name))

    def keep_out(self, name: str) -> bool:
        """Log a robot off and refuse its name from now on, also after a restart; whether it was logged on. Raises
        InvalidChoice, SimulationBusy, ServiceError."""
        if fault := name_fault(name):
            raise InvalidChoice("robot", fault)
        with self._administering:
            if name not in self.registry.kept_out and len(self.registry.kept_out) >= MAX_KEPT_OUT:
                raise InvalidChoice("robot", f"{MAX_KEPT_OUT} names are kept out already; admit some")
            self._store.keep_out(name)
            self.loop.do(lambda: self.registry.kept_out.add(name))
        with contextlib.suppress(UnknownRobot, SessionExpired):
            self.evict(name)
            return True
        return False

    def admit(self, name: str) -> bool:
        """Let a name in again; whether it was kept out. Raises SimulationBusy, ServiceError."""
        with self._administering:
            was_kept_out = name in self.registry.kept_out
            self._store.admit(name)
            self.loop.do(lambda: self.registry.kept_out.discard(name))
            return was_kept_out

    @property
    def kept_out(self) -> list[str]:
        """The names that are kept out, sorted."""
        with self._administering:
            return sorted(self.registry.kept_out)

    def robots_near(self, thing: str) -> list[str]:
        """The names of all robots: those on the floor of a body first, the nearest of them first."""
        there = self._place_of(thing)

        def rank(session: Session) -> tuple[bool, float]:
            at = session.robot.state().pose
            if there is None:
                return True, 0.0
            return at.floor != there.floor, math.dist((at.x, at.y), (there.x, there.y))

        return [session.name for session in sorted(self.sessions.values(), key=rank)]

    def _place_of(self, body: str) -> Pose | None:
        """The pose of a robot or a movable object, None if there is none of that name."""
        for floor in self.database.floors:
            with contextlib.suppress(UnknownFloor):  # it was removed a moment ago
                update = self.database.floor(floor)
                numbers = [each.number for each in update.came if each.name == body]
                for row in update.motions:
                    if int(row["number"]) in numbers:
                        return Pose(floor, float(row["x"]), float(row["y"]), float(row["heading"]))
        return None

    # ---- time ----

    def step(self) -> None:
        """Advance by STEP_S. For use without `start` only: a started simulation advances in its own thread."""
        self._report(self.simulated.step())

    def place(self, body: str, pose: Pose) -> None:
        """Put a robot or a movable object at a pose, at rest, and store that before returning.

        Raises UnknownBody, UnknownFloor, PlaceTaken, InvalidChoice, SimulationBusy, ServiceError."""
        self._do_durably(lambda: self._report(self.simulated.place(body, pose)))

    def configure(self, *, limit: int | None = None, pace: float | None = None, is_paused: bool | None = None) -> None:
        """Change settings and store them before returning. Raises InvalidChoice, SimulationBusy, ServiceError."""
        if limit is not None and not 0 <= limit <= MAX_ROBOTS:
            raise InvalidChoice("robots", f"{limit} is not 0 to {MAX_ROBOTS}")
        if pace is not None:
            check_pace(pace)

        wanted = {"limit": limit, "pace": pace, "paused": is_paused}
        given = {name: value for name, value in wanted.items() if value is not None}

        with self._administering:  # what is stored last is what was applied last
            before = AdministratorSettings(self.registry.limit, self.loop.pace, self.loop.is_paused)
            after = msgspec.structs.replace(before, **given)
            self.loop.do(lambda: self._apply(after))
            try:
                self._store.save_settings(after)
            except ServiceError:
                self.loop.do(lambda: self._apply(before))
                raise

    def _apply(self, settings: AdministratorSettings) -> None:
        self.registry.limit = settings.limit
        self.loop.configure(settings.pace, settings.paused)

    # ---- the map ----

    def follow_map(self, edited_map: Building, version: int, lineage: Lineage = SAME_NAMES) -> None:
        """Use an edited map; log off the robots on removed floors. The simulation goes on meanwhile, however large the
        edit is. lineage: which of its elements are those of the present map. One thread at a time.

        Raises SimulationBusy."""

        def change() -> None:
            # Before their floors go, so that nobody sees a robot without its floor.
            for name in self.simulated.robots_on_lost_floors(edited_map, lineage):
                self._log_off(self.registry.find(name))
            self._report(self.simulated.update(edited_map, lineage))
            self.database.map_version = version

        for preparation in self.simulated.preparations(edited_map, lineage):
            self.loop.do(preparation)
        self.loop.do(change)

    # ---- state ----

    @property
    def state(self) -> ServerState:
        return ServerState(
            self.registry.limit,
            len(self.registry),
            self.simulated.time,
            self.loop.pace,
            self.loop.achieved,
            self.loop.is_paused,
            self.database.map_version,
            self.collisions,
            self._event_rate,
        )

    # ---- internals, in the caller's thread ----

    def _restore(self, lineage_since: Callable[[int], Lineage]) -> None:
        """Restore the building and the sessions from the store, before the simulation thread starts."""
        records = self._store.clients()
        # A kill between a log-off and its write can leave two records of one name: the later one counts.
        clients = {record.name: record for record in records if record.name not in self.registry.kept_out}
        world = self._store.world() or self.simulated.record()
        if world.map_version not in (0, self.database.map_version):
            world = with_present_names(world, self.simulated.building, lineage_since(world.map_version))
        # The world record may hold the pose of an earlier robot of the same name.
        robots = {
            name: robot
            for name, robot in world.robots.items()
            if name in clients and world.keys.get(name) == clients[name].key
        }
        world = msgspec.structs.replace(world, robots=robots)
        self.simulated.restore(world, [record.description for record in clients.values()])
        for record in records:
            # Else its floor was removed from the map, or a kill came before its log-off was written.
            is_restored = record.name in self.simulated.occupants.robots
            if is_restored and clients.get(record.name) is record:
                self._open_session(self.registry.restore(record.description, record.key, record.since))
            else:
                self._store.forget_client(record.key)

    def _log_off_durably(self, client: RobotClient) -> None:
        """Log a robot off and delete its record. Raises SessionExpired, SimulationBusy, ServiceError."""
        self._writer.wait(self.loop.do(lambda: self._log_off(client)))

    def _do_durably(self, change: Callable[[], None], undo: Callable[[], object] | None = None) -> None:
        """Make a change in the simulation thread, and wait until it is written to disk; if that fails, undo it.

        Without `undo` the change stays, and is written when that is possible again. Raises ServiceError either way."""

        def change_and_submit(change: Callable[[], object]) -> int:
            change()
            return self._writer.submit(self._record())

        try:
            self._writer.wait(self.loop.do(lambda: change_and_submit(change)))
        except ServiceError:
            if undo:
                with contextlib.suppress(SimulationError):  # the robot may have been logged off meanwhile
                    self.loop.do(lambda: change_and_submit(undo))
            raise

    # ---- internals, in the simulation thread ----

    def _report(self, events: Iterable[SimulationEvent]) -> None:
        """Count and publish events."""
        for event in events:
            self.collisions += event.kind == "collision"
            self._event_count += 1
            self._publish(event)

    def _log_on(self, description: Description) -> Session:
        self.registry.check(description)
        self.simulated.add(description)
        self.simulated.refresh()
        session = self._open_session(self.registry.register(description))
        self._session_began(session)
        return session

    def _open_session(self, client: RobotClient) -> Session:
        robot = self.simulated.occupants.robots[client.name]
        self.load_balance.assign(client.name)
        session = Session(client, robot, self.simulated, self._do_durably, self._log_off_durably)
        self.sessions[client.key] = session
        return session

    def _log_off(self, client: RobotClient) -> int:
        """Remove a robot from the building, close its session, and queue the removal of its record, by the number that
        it returns. Raises SessionExpired."""
        if client.is_logged_off:
            raise SessionExpired()
        self.simulated.remove(client.name)
        self.simulated.refresh()
        self._close_session(client)
        return self._writer.forget(client.key)

    def _close_session(self, client: RobotClient) -> None:
        """Unregister a robot whose body is gone, and end its session."""
        self.registry.remove(client)
        self.load_balance.release(client.name)
        self.database.forget_scans(client.name)
        self._session_ended(self.sessions.pop(client.key))

    def _record(self) -> WorldRecord:
        keys = {client.name: client.key for client in self.registry.clients}
        return msgspec.structs.replace(self.simulated.record(), keys=keys, map_version=self.database.map_version)

    def _housekeeping(self) -> None:
        self._lease_time.attend()
        now = time.monotonic()
        if now - self._checked_at >= 0.1:  # interval between checks of leases [s]
            self._checked_at = now
            for client in self.registry.expired() if self._are_leases_running else ():
                _log.info("%s logged off: its lease of %g s expired", client.name, self.registry.lease_s)
                self.simulated.fall_silent(client.name)
                self._log_off(client)
        if now - self._written_at >= 0.1:  # interval between writes [s]; a kill loses at most twice as much
            self._written_at = now
            self._writer.submit(self._record())
        if now - self._counted_at >= 2.0:  # window of the average [s]
            self._event_rate = (self._event_count - self._counted_events) / (now - self._counted_at)
            self._counted_events, self._counted_at = self._event_count, now
