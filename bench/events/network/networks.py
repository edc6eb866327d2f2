"""The two sub-networks of the paper with a router between them.

As root on Linux, each host is a network namespace. Otherwise all hosts share the loopback, and a relay delays the
traffic between the sub-networks.
"""

from __future__ import annotations

import contextlib
import os
import socket
import statistics
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

from bench.common.namespaces import Namespace
from bench.common.processes import Process

#: Robots A and B are in room I with a computer for its channel, robot C in room II with the server computer.
SUBNET_OF = {"A": "I", "B": "I", "channel": "I", "C": "II", "server": "II"}
#: Last byte of the address of each host.
_NUMBER_OF = {"A": 2, "B": 3, "channel": 4, "C": 2, "server": 3}
#: Third byte of the addresses of each sub-network; in the paper the gateways are 192.168.0.1 and 192.168.8.1.
_SUBNET_NUMBER = {"I": 0, "II": 8}
#: Ports of the servers relative to the base port; every robot has its own host.
PORTS = {"naming": 0, "central": 1, "channel": 2, "robot": 3}
_NAMESPACE_BASE_PORT = 28090
ECHO_LIMIT_S = 2.0


class Counts(NamedTuple):
    """Traffic over the link so far, from sub-network I to II and back; with IP and TCP headers unless relayed."""

    packets: tuple[int, int]
    bytes: tuple[int, int]

    def since(self, before: Counts) -> Counts:
        """The traffic since `before`."""
        forth, back = (
            [now - then for now, then in zip(mine, theirs, strict=True)]
            for mine, theirs in zip(zip(*self, strict=True), zip(*before, strict=True), strict=True)
        )
        return Counts((forth[0], back[0]), (forth[1], back[1]))


class Network(Protocol):
    """The network in which the hosts run."""

    #: Description for the results.
    how: str
    #: What is delayed: packets, or parts of TCP streams.
    holds: str
    router: Process
    router_has_priority: bool

    def start(self, host: str, of: str, command: Sequence[str], log: Path, cores: Sequence[int]) -> Process:
        """Run a command on a host. of: key of PORTS for the port that it listens on."""

    def address(self, host: str, of: str, seen_from: str) -> str:
        """HOST:PORT of a port (key `of` of PORTS) of `host`, as the host `seen_from` reaches it."""

    def echo(self) -> tuple[Callable[[], object], Callable[[], object]]:
        """Functions that send a byte from robot A to robot C and wait for its return, and that return it."""


def counts(network: Network, **command: float) -> Counts:
    """Traffic over the link so far. delay_us: sets the one-way delay."""
    answer = network.router.ask(command)
    return Counts(tuple(answer["packets"]), tuple(answer["bytes"]))


def round_trips_us(network: Network, number: int) -> list[float]:
    """Round-trip times of a byte from robot A to robot C and back, without an ORB [us]."""
    forth, back = network.echo()

    def answer() -> None:
        with contextlib.suppress(OSError):
            for _ in range(number):
                back()

    answering = threading.Thread(target=answer, daemon=True)
    answering.start()
    times = []
    for _ in range(number):
        began = time.perf_counter()
        forth()
        times.append(1e6 * (time.perf_counter() - began))
        time.sleep(0.002)
    answering.join(ECHO_LIMIT_S)
    return times


class NamespaceNetwork:
    """Hosts, and a gateway for each sub-network, in network namespaces; a router process on TUN devices."""

    how = "network namespaces, packets delayed by a router process on TUN devices"
    holds = "packets"

    def __init__(self, stack: contextlib.ExitStack, folder: Path, cores: Sequence[int]) -> None:
        """Create the network, which ends with `stack`. Raises OSError without the right to create namespaces."""
        devices = []
        self._hosts: dict[str, Namespace] = {}
        for subnet, other in (("I", "II"), ("II", "I")):
            gateway = stack.enter_context(Namespace())
            gateway.forward_packets()
            gateway.add_bridge(f"{_gateway(subnet)}/24")
            for host in (host for host, where in SUBNET_OF.items() if where == subnet):
                self._hosts[host] = stack.enter_context(Namespace())
                gateway.add_host(self._hosts[host], _NUMBER_OF[host], f"{_ip(host)}/24", _gateway(subnet))
            devices.append(gateway.add_tun(f"192.168.{_SUBNET_NUMBER[other]}.0/24"))
            stack.callback(os.close, devices[-1])
        command = (sys.executable, "-m", "bench.events.network.router", *map(str, devices))
        self.router = stack.enter_context(Process(command, folder / "router.log", cores, pass_fds=devices))
        self.router_has_priority = bool(self.router.receive(20.0)["priority"])
        self._sockets = stack

    def start(self, host: str, of: str, command: Sequence[str], log: Path, cores: Sequence[int]) -> Process:
        return Process(self._hosts[host].command(*command), log, cores)

    def address(self, host: str, of: str, seen_from: str) -> str:
        return f"{_ip(host)}:{_NAMESPACE_BASE_PORT + PORTS[of]}"

    def echo(self) -> tuple[Callable[[], object], Callable[[], object]]:
        a, c = self._socket("A"), self._socket("C")
        a.connect(c.getsockname())
        return (lambda: (a.send(b"?"), a.recv(1))), (lambda: c.sendto(*c.recvfrom(1)))

    def _socket(self, host: str) -> socket.socket:
        found = self._hosts[host].inside(lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        self._sockets.enter_context(found)
        found.bind((_ip(host), 0))
        found.settimeout(ECHO_LIMIT_S)
        return found


class RelayNetwork:
    """All hosts on the loopback with an address each; a relay process for connections between sub-networks.

    Each object is published at two addresses: its host's own, and the relay's for it. A configuration file of omniORB
    selects the address that each host uses."""

    how = "loopback, TCP streams delayed by a relay process (no right to make network namespaces)"
    holds = "parts of TCP streams"

    def __init__(self, stack: contextlib.ExitStack, folder: Path, cores: Sequence[int]) -> None:
        self._base = _free_base_port()
        streams = [*(f"{host}:robot" for host in "ABC"), "server:naming", "server:central", "server:channel"]
        pairs = [self._pair(*stream.split(":")) for stream in (*streams, "channel:channel", "C:echo")]
        command = (sys.executable, "-m", "bench.events.network.relay", *pairs)
        self.router = stack.enter_context(Process(command, folder / "router.log", cores))
        self.router_has_priority = bool(self.router.receive(20.0)["priority"])
        self._sockets = stack

    def start(self, host: str, of: str, command: Sequence[str], log: Path, cores: Sequence[int]) -> Process:
        settings = log.with_suffix(".cfg")
        settings.write_text(self._settings(host, of))
        return Process(command, log, cores, {"OMNIORB_CONFIG": str(settings)})

    def address(self, host: str, of: str, seen_from: str) -> str:
        block = 64 if SUBNET_OF[host] == SUBNET_OF[seen_from] else 65
        return f"127.{block}.{_SUBNET_NUMBER[SUBNET_OF[host]]}.{_NUMBER_OF[host]}:{self._port(of)}"

    def echo(self) -> tuple[Callable[[], object], Callable[[], object]]:
        listener = socket.create_server(_split(self.address("C", "echo", "C")))
        a = self._sockets.enter_context(socket.create_connection(_split(self.address("C", "echo", "A")), ECHO_LIMIT_S))
        listener.settimeout(ECHO_LIMIT_S)
        c = self._sockets.enter_context(listener.accept()[0])
        listener.close()
        for end in (a, c):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            end.settimeout(ECHO_LIMIT_S)
        return (lambda: (a.send(b"?"), a.recv(1))), (lambda: c.send(c.recv(1)))

    def _settings(self, host: str, of: str) -> str:
        """Configuration of omniORB: publish both addresses; call hosts of the other sub-network through the relay."""
        other = self._other(host)
        published = ",".join(f"giop:tcp:{self.address(host, of, end)}" for end in (host, other))
        near, far = (_SUBNET_NUMBER[SUBNET_OF[end]] for end in (host, other))
        rules = f"127.64.{near}.0/255.255.255.0 tcp", f"127.65.{far}.0/255.255.255.0 tcp", "* none"
        return f"endPointPublish = {published}\n" + "".join(f"clientTransportRule = {rule}\n" for rule in rules)

    def _port(self, of: str) -> int:
        return self._base + {**PORTS, "echo": len(PORTS)}[of]

    def _pair(self, host: str, of: str) -> str:
        """Argument of the relay: the address where it listens, and its target."""
        return f"{self.address(host, of, self._other(host))}={self.address(host, of, host)}"

    @staticmethod
    def _other(host: str) -> str:
        """A host of the other sub-network."""
        return next(name for name, subnet in SUBNET_OF.items() if subnet != SUBNET_OF[host])


@contextlib.contextmanager
def networks(folder: Path, cores: Sequence[int], relay: bool = False) -> Iterator[Network]:
    """The best network that this machine allows; it ends with the `with`."""
    with contextlib.ExitStack() as stack:
        if not relay:
            with contextlib.ExitStack() as attempt:
                try:
                    network = NamespaceNetwork(attempt, folder, cores)
                except OSError as error:
                    print(f"no network namespaces here ({error}); a relay on the loopback instead", file=sys.stderr)
                else:
                    stack.enter_context(attempt.pop_all())
                    yield network
                    return
        yield RelayNetwork(stack, folder, cores)


def describe_round_trips(times_us: Sequence[float]) -> dict[str, float]:
    """Median and p95 [us]."""
    ordered = sorted(times_us)
    return {"p50": round(statistics.median(ordered), 1), "p95": round(ordered[int(0.95 * len(ordered))], 1)}


def _ip(host: str) -> str:
    return f"192.168.{_SUBNET_NUMBER[SUBNET_OF[host]]}.{_NUMBER_OF[host]}"


def _gateway(subnet: str) -> str:
    return f"192.168.{_SUBNET_NUMBER[subnet]}.1"


def _split(address: str) -> tuple[str, int]:
    host, port = address.rsplit(":", 1)
    return host, int(port)


def _free_base_port() -> int:
    """The first of a range of free ports: one for each of PORTS, and one for the echo."""
    size = len(PORTS) + 1
    for base in range(20000 + 8 * (os.getpid() % 1200), 32000, 8):
        with contextlib.ExitStack() as probes:
            try:
                for port in range(base, base + size):
                    probes.enter_context(socket.socket()).bind(("", port))
            except OSError:
                continue
            return base
    raise OSError("no free ports")
