"""The communication management agent: lets robots log on to the simulated building, and off, and lets time pass."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

import msgspec

from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import InvalidChoice, SessionExpired, UnknownRobot
from robocorba.maps.model import Building
from robocorba.simulation import omni_database, physics
from robocorba.simulation.building import Happening, SimulatedBuilding
from robocorba.simulation.load_balance import LoadBalance
from robocorba.simulation.omni_database import LastScan, OmniDatabase
from robocorba.simulation.registry import Description, Registry, RobotClient
from robocorba.simulation.session import Session
from robocorba.simulation.simulation_loop import SimulationLoop, check_pace
from robocorba.simulation.state_writer import StateWriter
from robocorba.simulation.store import Choices, ClientRecord, SimulationStore
from robocorba.simulation.world_record import WorldRecord

#: Robots at most, unless an administrator chose another limit, and how many he may choose.
DEFAULT_LIMIT, MOST_ROBOTS = 300, 10_000
#: Poses are kept at least so often, s: twice as often as what may be lost by a kill.
WRITE_INTERVAL_S = 0.1
#: Leases are looked at so often, s.
LEASE_CHECK_INTERVAL_S = 0.1
#: Event rates are those of so many seconds.
RATE_WINDOW_S = 2.0

_log = logging.getLogger(__name__)


class ServerState(NamedTuple):
    """limit and robots: that may be, and are, logged on. pace: simulated seconds in a second, as asked for (0: as many
    as possible) and achieved. event_rate: happenings a second."""

    limit: int
    robots: int
    time: float
    pace: float
    achieved: float
    is_paused: bool
    map_version: int
    collisions: int
    event_rate: float


class ManagementAgent:
    """The simulation of a building, as `store` remembers it, else as it is on the map.

    announce: is told what happens, in the thread of the simulation; must not wait. gone: is told whose session ended.
    Everything else is safe from any thread, once `start` was called. Leases run from `begin_leases` on."""

    def __init__(
        self,
        building: Building,
        map_version: int,
        store: SimulationStore,
        publish: Callable[[Happening], None] = lambda happening: None,
        session_ended: Callable[[Session], None] = lambda session: None,
    ) -> None:
        self._store, self._publish, self._session_ended = store, publish, session_ended
        choices = store.choices() or Choices(DEFAULT_LIMIT)
        self.registry = Registry(choices.limit, time.monotonic)
        self.building = SimulatedBuilding(building)
        self.database = OmniDatabase(self.building)
        self.database.map_version = map_version
        self.sensors = LoadBalance(time.monotonic)
        self.loop = SimulationLoop(self.step, self._housekeeping)
        self.loop.configure(choices.pace, choices.paused)
        self.sessions: dict[str, Session] = {}
        self.collisions = 0
        self._event_count = self._counted_events = 0
        self._counted_at = self._written_at = self._checked_at = time.monotonic()
        self._event_rate = 0.0
        self._writer = StateWriter(store)
        self._are_leases_running = False
        self._restore()

    def start(self) -> None:
        """Let time pass."""
        physics.warm_up()
        omni_database.warm_up()
        self._writer.start()
        self.loop.start()

    def close(self) -> None:
        """Let time end; keep how everything is."""
        self.loop.close()
        self._writer.close()
        with contextlib.suppress(ServiceError):
            self._store.save_world(self._record())

    def begin_leases(self) -> None:
        """Calls are let in: whoever was logged on before has a whole lease from now on."""

        def begin() -> None:
            for client in self.registry.clients:
                client.last_call_at = time.monotonic()
            self._are_leases_running = True

        self.loop.do(begin)

    # ---- robots ----

    def register(self, description: Description) -> Session:
        """Log a robot on. Raises NameTaken, ServerFull, UnknownFloor, PlaceTaken, SimulationBusy, ServiceError."""
        session = self.loop.do(lambda: self._log_on(description))
        try:
            self._store.save_client(ClientRecord.of(session.client.key, session.client.since, description))
        except ServiceError:
            self.loop.do(lambda: self._log_off(session.client))
            raise
        return session

    def record_scans(self, latest: Iterable[LastScan]) -> None:
        """What robots' sensors saw last; a robot that scans is heard."""
        now = time.monotonic()
        for scan in latest:
            with contextlib.suppress(UnknownRobot, SessionExpired):
                self.registry.find(scan.robot).renew_lease(now)
                self.database.record_scan(scan)

    def evict(self, name: str) -> None:
        """Log a robot off. Raises UnknownRobot, SimulationBusy, ServiceError."""
        self._end(self.registry.find(name))

    # ---- time ----

    def step(self) -> None:
        """Let one step of STEP_S pass. Where `start` was called, time passes by itself: not for use then."""
        for happening in self.building.step():
            self.collisions += happening.kind == "collision"
            self._event_count += 1
            self._publish(happening)

    def configure(self, *, limit: int | None = None, pace: float | None = None, is_paused: bool | None = None) -> None:
        """What an administrator sets, kept before this returns. Raises InvalidChoice, SimulationBusy, ServiceError."""
        if limit is not None and not 0 <= limit <= MOST_ROBOTS:
            raise InvalidChoice("robots", f"{limit} is not 0 to {MOST_ROBOTS}")
        if pace is not None:
            check_pace(pace)

        def change() -> Choices:
            self.registry.limit = self.registry.limit if limit is None else limit
            self.loop.configure(
                self.loop.pace if pace is None else pace, self.loop.is_paused if is_paused is None else is_paused
            )
            return Choices(self.registry.limit, self.loop.pace, self.loop.is_paused)

        self._store.save_choices(self.loop.do(change))

    # ---- the map ----

    def follow_map(self, building: Building, version: int) -> None:
        """Follow an edited map; robots whose floor is gone are logged off. Raises SimulationBusy."""

        def change() -> None:
            for name in self.building.update(building):
                client = self.registry.find(name)
                self._forget(client)
                self._writer.forget(client.key)
            self.database.map_version = version

        self.loop.do(change)

    # ---- what there is to see ----

    @property
    def state(self) -> ServerState:
        return ServerState(
            self.registry.limit,
            len(self.registry),
            self.building.time,
            self.loop.pace,
            self.loop.achieved,
            self.loop.is_paused,
            self.database.map_version,
            self.collisions,
            self._event_rate,
        )

    # ---- inside, all in the thread of the simulation ----

    def _restore(self) -> None:
        kept = self._store.clients()
        # A kill may have come between a log-off and its being kept, when the name had been taken anew.
        clients = {record.name: record for record in kept}
        world = self._store.world() or self.building.record()
        # Nor may it tell of somebody else who had the name before.
        same = {name: robot for name, robot in world.robots.items() if _belongs_to(world, clients.get(name))}
        world = msgspec.structs.replace(world, robots=same)
        self.building.restore(world, [record.description for record in clients.values()])
        for record in kept:
            is_here = record.name in self.building.robots  # else its floor is not on the map any more
            if is_here and clients[record.name] is record:
                self._open(self.registry.restore(record.description, record.key, record.since))
            else:
                self._store.forget_client(record.key)

    def _log_on(self, description: Description) -> Session:
        self.registry.check(description)
        self.building.add(description)
        self.building.refresh()
        return self._open(self.registry.register(description))

    def _open(self, client: RobotClient) -> Session:
        robot = self.building.robots[client.name]
        self.sensors.assign(client.name)
        session = Session(client, robot, self.building, self._do_durably, self._end)
        self.sessions[client.key] = session
        return session

    def _end(self, client: RobotClient) -> None:
        self.loop.do(lambda: self._log_off(client))
        self._store.forget_client(client.key)

    def _log_off(self, client: RobotClient) -> None:
        if client.is_logged_off:
            raise SessionExpired()
        self.building.remove(client.name)
        self.building.refresh()
        self._forget(client)

    def _forget(self, client: RobotClient) -> None:
        self.registry.remove(client)
        self.sensors.release(client.name)
        self.database.forget_scans(client.name)
        self._session_ended(self.sessions.pop(client.key))

    def _do_durably(self, change: Callable[[], None]) -> None:
        """Make a change, and wait until it can't be lost any more."""

        def change_and_submit() -> int:
            change()
            return self._writer.submit(self._record())

        self._writer.wait(self.loop.do(change_and_submit))

    def _record(self) -> WorldRecord:
        keys = {client.name: client.key for client in self.registry.clients}
        return msgspec.structs.replace(self.building.record(), keys=keys)

    def _housekeeping(self) -> None:
        now = time.monotonic()
        if now - self._checked_at >= LEASE_CHECK_INTERVAL_S:
            self._checked_at = now
            for client in self.registry.expired() if self._are_leases_running else ():
                _log.info("%s was silent for %g s: logged off", client.name, self.registry.lease_s)
                self._log_off(client)
                self._writer.forget(client.key)
        if now - self._written_at >= WRITE_INTERVAL_S:
            self._written_at = now
            self._writer.submit(self._record())
        if now - self._counted_at >= RATE_WINDOW_S:
            self._event_rate = (self._event_count - self._counted_events) / (now - self._counted_at)
            self._counted_events, self._counted_at = self._event_count, now


def _belongs_to(world: WorldRecord, client: ClientRecord | None) -> bool:
    """Whether a record tells of this client's robot."""
    return client is not None and world.keys.get(client.name) == client.key
