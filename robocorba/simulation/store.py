"""The simulation server's store, from which it is restored after kill -9: clients, poses, settings, missions.

Poses are written every 0.1 s, so a kill loses the latest ones; all other records are written before a call returns.
"""

from __future__ import annotations

import threading
from pathlib import Path

import msgspec

from robocorba.errors.simulation import InvalidMission, NoRoom, StaleMission, UnknownMission
from robocorba.map_editor.element_rules import name_violations
from robocorba.map_editor.spatial.pose import Limits, Pose
from robocorba.simulation.registry import Description
from robocorba.simulation.world_record import WorldRecord
from robocorba.system.record_file import RecordFile

#: "RoCs": marks store files of the simulation server.
APPLICATION_ID = 0x526F4373
#: Maximum number of missions.
MAX_MISSIONS = 1000
#: Maximum size of one mission's document [bytes].
MAX_DOCUMENT = 1024 * 1024
#: Maximum size of all documents [bytes], so that one CORBA message holds them.
MAX_DOCUMENTS = 32 * 1024 * 1024


class ClientRecord(msgspec.Struct, frozen=True, array_like=True):
    """A logged-on robot client. key: digest of its session's secret. since: POSIX time of the log-on [s]."""

    key: str
    since: float
    name: str
    pose: tuple[str, float, float, float]
    radius_m: float
    mass_kg: float
    limits: tuple[float, float, float, float]

    @classmethod
    def of(cls, key: str, since: float, robot: Description) -> ClientRecord:
        return cls(key, since, robot.name, robot.pose, robot.radius_m, robot.mass_kg, robot.limits)

    @property
    def description(self) -> Description:
        return Description(self.name, Pose(*self.pose), self.radius_m, self.mass_kg, Limits(*self.limits))


class AdministratorSettings(msgspec.Struct, frozen=True):
    """Settings of the administrator. limit: maximum number of robots. pace: simulated seconds per second."""

    limit: int
    pace: float = 1.0
    paused: bool = False


class Mission(msgspec.Struct, frozen=True, array_like=True):
    """A mission as stored by its leader.

    version: increases by one with each change. document: its content, which the server does not read."""

    name: str
    version: int
    document: bytes


class SimulationStore(RecordFile):
    """The records in a file, for one process at a time. Raises AlreadyRunning; ServiceError for an unusable file."""

    def __init__(self, file: Path) -> None:
        super().__init__(file, APPLICATION_ID, 1)  # the version of the schema
        self._forget_secrets()
        self._writing_missions = threading.Lock()
        self._missions = {mission.name: mission for mission in self.all("mission", Mission)}

    def clients(self) -> list[ClientRecord]:
        """Records of the clients in the order of their log-on."""
        return self.all("client", ClientRecord)

    def save_client(self, record: ClientRecord) -> None:
        self.save("client", record.key, record)

    def forget_client(self, key: str) -> None:
        self.delete("client", key)

    def world(self) -> WorldRecord | None:
        """The last world record; None if none was written."""
        return next(iter(self.all("world", WorldRecord)), None)

    def save_world(self, world: WorldRecord) -> None:
        self.save("world", "", world)

    def settings(self) -> AdministratorSettings | None:
        """The settings; None if an administrator never changed them."""
        return next(iter(self.all("choices", AdministratorSettings)), None)

    def save_settings(self, settings: AdministratorSettings) -> None:
        self.save("choices", "", settings)

    def kept_out(self) -> set[str]:
        """Names of robots that an administrator keeps out."""
        return set(self.all("kept out", str))

    def keep_out(self, name: str) -> None:
        self.save("kept out", name, name)

    def admit(self, name: str) -> None:
        self.delete("kept out", name)

    def administrator(self) -> str:
        """The digest of the administrators' secret; empty if there is none yet."""
        return next(iter(self.all("administrator", str)), "")

    def save_administrator(self, digest: str) -> None:
        self.save("administrator", "", digest)

    def _forget_secrets(self) -> None:
        """Earlier releases stored secrets themselves: remove all of them. Their references are no longer valid."""
        if not self.all("secret", str):
            return
        for client in self.clients():
            self.forget_client(client.key)
        if world := self.world():
            self.save_world(msgspec.structs.replace(world, keys={}))
        self.delete("secret", "")
        self.compact()

    # ---- missions ----

    def missions(self) -> list[Mission]:
        """All missions, in the order in which they were first stored."""
        with self._writing_missions:
            return list(self._missions.values())

    def mission(self, name: str) -> Mission | None:
        """A mission by its name; None if there is none."""
        with self._writing_missions:
            return self._missions.get(name)

    def put_mission(self, mission: Mission) -> int:
        """Store a mission if `mission.version` is the stored version, 0 for a new mission; return its new version.

        Raises InvalidMission, StaleMission; NoRoom if others have to be removed first."""
        for reason in name_violations("it", mission.name):
            raise InvalidMission("name", reason)
        if len(mission.document) > MAX_DOCUMENT:
            raise InvalidMission("document", f"has {len(mission.document)} bytes; at most {MAX_DOCUMENT}")
        with self._writing_missions:
            stored = self._missions.get(mission.name)
            current = stored.version if stored else 0
            if mission.version != current:
                raise StaleMission(mission.name, mission.version, current)
            self._check_room(mission)
            changed = Mission(mission.name, current + 1, mission.document)
            self.save("mission", changed.name, changed)
            self._missions[changed.name] = changed
            return changed.version

    def remove_mission(self, name: str) -> None:
        """Remove a mission. Raises UnknownMission."""
        with self._writing_missions:
            if name not in self._missions:
                raise UnknownMission(name)
            self.delete("mission", name)
            del self._missions[name]

    def _check_room(self, mission: Mission) -> None:
        """Raise NoRoom unless there is room for a mission. Requires the lock."""
        if mission.name not in self._missions and len(self._missions) >= MAX_MISSIONS:
            raise NoRoom("name", f"{MAX_MISSIONS} missions are stored already; remove one")
        others = sum(len(other.document) for name, other in self._missions.items() if name != mission.name)
        if others + len(mission.document) > MAX_DOCUMENTS:
            raise NoRoom("document", f"all missions would exceed {MAX_DOCUMENTS} bytes; remove one")
