"""The two sub-networks of the paper with a router between them; each host is a network namespace, which needs root."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from testkit.json_process import Process
from testkit.namespaces import Namespace, start_router

#: Robots A and B are in room I with a computer for its channel, robot C in room II with the server computer.
SUBNET_OF = {"A": "I", "B": "I", "channel": "I", "C": "II", "server": "II"}
#: Last byte of the address of each host.
_NUMBER_OF = {"A": 2, "B": 3, "channel": 4, "C": 2, "server": 3}
#: Third byte of the addresses of each sub-network; in the paper the gateways are 192.168.0.1 and 192.168.8.1.
_SUBNET_NUMBER = {"I": 0, "II": 8}
#: Ports of the servers; every robot has its own host.
PORTS = {"naming": 28090, "central": 28091, "channel": 28092, "robot": 28093}
ECHO_LIMIT_S = 2.0


class Counts(NamedTuple):
    """Traffic over the link so far in both directions, with IP and TCP headers."""

    packets: int
    bytes: int

    def since(self, before: Counts) -> Counts:
        """The traffic since `before`."""
        return Counts(self.packets - before.packets, self.bytes - before.bytes)


class Network:
    """Hosts, and a gateway for each sub-network; a router process on TUN devices. Use it in a `with`."""

    def __init__(self, folder: Path, cores: Sequence[int]) -> None:
        """Raises OSError without the right to create namespaces."""
        self.folder, self._cores = folder, cores
        self._hosts: dict[str, Namespace] = {}
        with contextlib.ExitStack() as stack:
            devices = []
            for subnet, other in (("I", "II"), ("II", "I")):
                gateway = stack.enter_context(Namespace())
                gateway.forward_packets()
                gateway.add_bridge(f"{_gateway(subnet)}/24")
                for host in (host for host, where in SUBNET_OF.items() if where == subnet):
                    self._hosts[host] = stack.enter_context(Namespace())
                    gateway.add_host(self._hosts[host], _NUMBER_OF[host], f"{_ip(host)}/24", _gateway(subnet))
                devices.append(gateway.add_tun(f"192.168.{_SUBNET_NUMBER[other]}.0/24"))
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
        return Process(self._hosts[host].command(*command), self.folder / f"{name}.log", cores or self._cores)

    def counts(self, **command: float) -> Counts:
        """Traffic over the link so far. delay_us: sets the one-way delay."""
        answer = self._router.ask(command)
        return Counts(sum(answer["packets"]), sum(answer["bytes"]))

    def round_trips_us(self, number: int) -> list[float]:
        """Round-trip times of a byte from robot A to robot C and back, without an ORB [us]."""
        with self._socket("A") as a, self._socket("C") as c:
            a.connect(c.getsockname())

            def answer() -> None:
                with contextlib.suppress(OSError):
                    for _ in range(number):
                        c.sendto(*c.recvfrom(1))

            answering = threading.Thread(target=answer, daemon=True)
            answering.start()
            times = []
            for _ in range(number):
                began = time.perf_counter()
                a.send(b"?")
                a.recv(1)
                times.append(1e6 * (time.perf_counter() - began))
                time.sleep(0.002)
            answering.join(ECHO_LIMIT_S)
        return times

    def _socket(self, host: str) -> socket.socket:
        found = self._hosts[host].inside(lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        found.bind((_ip(host), 0))
        found.settimeout(ECHO_LIMIT_S)
        return found


def address(host: str, of: str) -> str:
    """HOST:PORT of a server (key of PORTS) on a host."""
    return f"{_ip(host)}:{PORTS[of]}"


def _ip(host: str) -> str:
    return f"192.168.{_SUBNET_NUMBER[SUBNET_OF[host]]}.{_NUMBER_OF[host]}"


def _gateway(subnet: str) -> str:
    return f"192.168.{_SUBNET_NUMBER[subnet]}.1"
