"""The computers of the paper in three sub-networks; each host is a network namespace, which needs root."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from robocorba.system.supervision.launch import module_command
from robocorba.system.supervision.system import find_omninames
from testkit.json_process import Process
from testkit.namespaces import Namespace, start_router

#: Robots A and B are in sub-network I, C in II, the computer of the map editor and the simulation server in one of its
#: own; I and II have a computer for a channel each. In the paper the gateways are 192.168.0.1 and 192.168.8.1.
SUBNET_OF = {"A": "I", "B": "I", "I": "I", "C": "II", "II": "II", "servers": "servers"}
ADDRESS_OF = {
    **{"A": "192.168.0.2", "B": "192.168.0.3", "I": "192.168.0.4"},
    **{"C": "192.168.8.2", "II": "192.168.8.3", "servers": "192.168.16.2"},
}


class Link(NamedTuple):
    """What connects the hosts: bit rate of each sub-network's shared segment [Mbit/s], 0 for no limit, and one-way
    delay between sub-networks [us]."""

    name: str
    mbit_s: float = 0.0
    delay_us: float = 0.0


class Counts(NamedTuple):
    """Traffic between sub-networks so far, with IP and TCP headers, and packets that found a full queue."""

    packets: int
    bytes: int
    dropped: int

    def since(self, before: Counts) -> Counts:
        """The traffic since `before`."""
        return Counts(*(now - then for now, then in zip(self, before, strict=True)))


class Network:
    """Hosts, and a process that carries their packets; what it models: testkit/router.py. Use it in a `with`."""

    def __init__(self, folder: Path, cores: Sequence[int], addresses: Mapping[str, str] = ADDRESS_OF) -> None:
        """addresses: by host. Raises OSError without the right to create namespaces."""
        self.folder, self._cores = folder, cores
        with contextlib.ExitStack() as stack:
            self.hosts = {host: stack.enter_context(Namespace()) for host in addresses}
            devices = {addresses[name]: host.add_tun(addresses[name]) for name, host in self.hosts.items()}
            self._router = stack.enter_context(start_router(devices, folder, cores))
            self._stack = stack.pop_all()

    @property
    def router_has_priority(self) -> bool:
        """Whether the router has real-time priority."""
        return os.sched_getscheduler(self._router.pid) == os.SCHED_FIFO

    def __enter__(self) -> Network:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def start(self, host: str, name: str, *command: str, cores: Sequence[int] = ()) -> Process:
        """Run a command on a host."""
        return Process(self.hosts[host].command(*command), self.folder / f"{name}.log", cores or self._cores)

    def start_naming(self, host: str, address: str) -> None:
        """A naming service on a host, until the end of the `with`."""
        data = self.folder / address
        data.mkdir()
        own = ("-start", address.rpartition(":")[2], "-always", "-nohostname", "-datadir", str(data))
        command = (find_omninames(), *own, "-ORBendPoint", f"giop:tcp:{address}")
        self._stack.enter_context(self.start(host, f"names-{address}", *command))

    def start_channel(self, host: str, name: str, address: str, naming: str, *more: str) -> Process:
        """An event channel on a host."""
        where = ("--state", str(self.folder / name), "--endpoint", address, "--naming", naming, "--name", name)
        return self.start(host, name, *module_command("robocorba.servers.event_channel", *where, *more))

    def change(self, link: Link, **more: Any) -> None:
        """Change what connects the hosts. more: further commands of testkit/router.py."""
        self._router.ask({"mbit_s": link.mbit_s, "delay_us": link.delay_us, **more})

    def counts(self) -> Counts:
        """Traffic between sub-networks so far."""
        return Counts(**self._router.ask({}))
