"""The state folder of a system: its lock, the port of each server, the processes that run.

lock           held (flock) by the `robocorba up` that uses the folder
ports.json     the ports of naming service and servers, kept so that references survive restarts
links.json     the peers with which each event channel was linked
up.json        the processes that run, replaced atomically at every change
supervisor.ior the reference of the supervisor, for this user only
logs/          a file for each process
past/          recordings of what the console saw last
omninames/     the bindings of the naming service

The folder and all files are for this user only. What is damaged of them is set aside, and written again.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec

from robocorba.errors.services import AlreadyRunning, PortInUse, ServiceError
from robocorba.system.damaged_files import set_aside
from robocorba.system.decoding import decode_json
from robocorba.system.endpoints import is_free
from robocorba.system.instances import instance_folders
from robocorba.system.names import CONSOLE, PORTS
from robocorba.system.private_files import claim_state
from robocorba.system.settings import Address

Schema = TypeVar("Schema")


class DamagedFile(ServiceError):
    """A file has another content than `up` writes."""


class ProcessRecord(msgspec.Struct):
    """A process in up.json. started: POSIX time [s]. pid: 0 while there is none. endpoint: empty for any port."""

    name: str
    state: str
    pid: int
    endpoint: str
    names: tuple[str, ...]
    started: float
    restarts: int


class SystemRecord(msgspec.Struct):
    """The content of up.json: the naming service's address, the supervisor and its processes.

    created: when the supervisor was started, see `started_s`.
    hang_limit_s: after this time without an answer a server is restarted; 0: never."""

    naming: str
    pid: int
    created: float
    processes: tuple[ProcessRecord, ...]
    hang_limit_s: float = 0.0

    @property
    def is_alive(self) -> bool:
        """Whether the supervisor that wrote it still runs. Its start time is compared, as process ids are reused."""
        try:
            return started_s(self.pid) == self.created
        except OSError:
            return False

    @property
    def console_address(self) -> str:
        """Where browsers find the operator's console, http://HOST:PORT/; empty if none belongs to the system."""
        return next((f"http://{process.endpoint}/" for process in self.processes if process.name == CONSOLE), "")


def started_s(pid: int) -> float:
    """When a process was started, in seconds after the boot of the system, whose clock may be set since. Raises OSError
    if there is no such process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()  # a name may have spaces
    return int(fields[19]) / os.sysconf("SC_CLK_TCK")


def running_instances() -> list[str]:
    """The names of this user's instances that run on this machine."""
    running = []
    for name, path in instance_folders().items():
        with contextlib.suppress(ServiceError):
            record = StateFolder(path).read_record()
            running += [name] if record and record.is_alive else []
    return running


@dataclass(frozen=True)
class StateFolder:
    """Reads and writes the files listed at the top of this module."""

    path: Path

    @property
    def logs(self) -> Path:
        return self.path / "logs"

    @property
    def names(self) -> Path:
        return self.path / "omninames"

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the folder; create it if it is missing, and make it private. Raises AlreadyRunning, or ServiceError for
        an unusable folder.

        The kernel releases the lock when this process ends, even by SIGKILL."""
        claim_state(self.path)
        try:
            self.names.mkdir(parents=True, exist_ok=True)
            lock = os.open(self.path / "lock", os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise ServiceError(f"can't use the state folder {self.path}: {error.strerror}") from None
        try:
            self._lock(lock)
            yield
        finally:
            os.close(lock)

    def _lock(self, lock: int) -> None:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = ""
            with contextlib.suppress(ServiceError):
                record = self.read_record()
                owner = f" (process id {record.pid})" if record and record.is_alive else ""
            raise AlreadyRunning(f"another robocorba up{owner} uses the state folder {self.path}") from None

    def ports(self, servers: Sequence[str], naming: Address) -> dict[str, int]:
        """The port of each server on the naming service's host: its former port, else the first free one after the
        naming service's, which is stored. Raises PortInUse if a former port is in use."""
        file = self.path / PORTS
        stored = self._read_or_set_aside(file, dict[str, int], "servers keep the ports of up.json, or get free ones")
        if stored is None:
            stored = self._ports_of_record()
        stored.pop("naming", None)
        for server in servers:
            port = stored.get(server)
            if port is None:
                stored[server] = self._next_port(naming, {naming.port, *stored.values()})
            elif port == naming.port or not is_free(naming.host, port):
                raise PortInUse(naming.host, port, f"{server} (stored in {file})")
        self._write(file, {**stored, "naming": naming.port})
        return {server: stored[server] for server in servers}

    def _ports_of_record(self) -> dict[str, int]:
        """The ports of a system that was killed; empty after a normal end."""
        record = None
        with contextlib.suppress(ServiceError):
            record = self.read_record()
        processes = [] if record is None else [process for process in record.processes if process.names]
        return {process.name: Address.parse(process.endpoint).port for process in processes if process.endpoint}

    def _next_port(self, naming: Address, taken: set[int]) -> int:
        for port in range(naming.port + 1, 65536):
            if port not in taken and is_free(naming.host, port):
                return port
        raise ServiceError(f"no port above {naming.port} is free on {naming.host}")

    def links(self) -> dict[str, list[str]]:
        """The peers with which systems in this folder linked each event channel."""
        consequence = "links of sub-networks that no longer exist stay until they are removed"
        return self._read_or_set_aside(self.path / "links.json", dict[str, list[str]], consequence) or {}

    def write_links(self, links: Mapping[str, Sequence[str]]) -> None:
        self._write(self.path / "links.json", links)

    def write_record(self, record: SystemRecord) -> None:
        self._write(self.path / "up.json", record)

    def read_record(self) -> SystemRecord | None:
        """The system that runs here, or ran last; None where none did. Raises ServiceError for a damaged file."""
        return self._read(self.path / "up.json", SystemRecord)

    def set_damaged_record_aside(self) -> None:
        """For the owner of the lock, before it writes a record of its own."""
        self._read_or_set_aside(self.path / "up.json", SystemRecord, "it is written again")

    def remove_record(self) -> None:
        (self.path / "up.json").unlink(missing_ok=True)

    def _read(self, file: Path, schema: type[Schema]) -> Schema | None:
        try:
            return decode_json(file.read_bytes(), schema)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise ServiceError(f"can't read {file}: {error.strerror}") from None
        except msgspec.MsgspecError as error:
            raise DamagedFile(f"{file} is damaged ({error}); robocorba up writes it again") from None

    def _read_or_set_aside(self, file: Path, schema: type[Schema], consequence: str) -> Schema | None:
        """As `_read`; a damaged file is set aside. For the owner of the lock."""
        try:
            return self._read(file, schema)
        except DamagedFile as error:
            try:
                set_aside(file, str(error.__context__), consequence)
            except OSError as failure:
                raise ServiceError(f"can't rename {file}, which is damaged: {failure.strerror}") from None
            return None

    def _write(self, file: Path, content: object) -> None:
        """Replace the file atomically. The lock makes this process the only writer."""
        new = file.with_suffix(".new")
        try:
            new.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=2))
            new.replace(file)
        except OSError as error:
            raise ServiceError(f"can't write {file}: {error.strerror}") from None
