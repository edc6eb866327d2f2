"""Event channels as real processes in any topology, with consumers in the test's process."""

from __future__ import annotations

import contextlib
import itertools
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import psutil
from omniORB import CORBA

from robocorba.events.corba.event_client import Event, EventClient, EventSubscription
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.claimed_ports import PORTS_PER_BLOCK, claimed_ports
from robocorba.system.settings import Address
from robocorba.system.supervision.launch import module_command
from robocorba.system.supervision.system import naming_service_command
from testkit.processes import Launcher, eventually, hang
from testkit.relay import Relay

#: Timeout of waits that normally take a second or two, for a busy machine [s].
LIMIT_S = 60.0
SERVER = "robocorba.servers.event_channel"


class Counts(NamedTuple):
    """The counters of an Account."""

    received: int
    delivered: int
    unconfirmed: int
    discarded: int
    expired: int
    queued: int

    @classmethod
    def of(cls, account: Any) -> Counts:
        return cls(*(getattr(account, field) for field in cls._fields))

    @property
    def is_exact(self) -> bool:
        return self.received == self.delivered + self.discarded + self.expired + self.queued


class Consumer:
    """Keeps the events that it received at one channel. types: empty for all."""

    def __init__(self, client: EventClient, types: Sequence[str], name: str = "") -> None:
        self.events: list[Event] = []
        self.subscription: EventSubscription = client.subscribe(self.events.append, *types, name=name)

    def payloads(self, origin: str, type: str = "t") -> list[Any]:
        return [event.payload for event in list(self.events) if (event.origin, event.type) == (origin, type)]


class Channels:
    """Channel processes by name, one naming service, and one client per channel."""

    def __init__(self, launch: Launcher, folder: Path, port: int, orb: Orb) -> None:
        self.orb, self.port, self.folder = orb, port, folder
        self.naming: subprocess.Popen[str] | None = None
        self.processes: dict[str, subprocess.Popen[str]] = {}
        self.clients: dict[str, EventClient] = {}
        self._launch = launch
        self._blocks = contextlib.ExitStack()
        self._ports = self._free_ports(port + 1)
        self._port_of: dict[str, int] = {}
        self._probes = itertools.count()
        #: Of channels behind relays; the links between them that are cut.
        self._relays: dict[str, Relay] = {}
        self._cut: set[frozenset[str]] = set()

    # ---- processes ----

    def _free_ports(self, first: int) -> Iterator[int]:
        """The rest of the claimed block, then those of further ones, which `close` gives back."""
        yield from range(first, first + PORTS_PER_BLOCK - 2)
        while True:
            block = self._blocks.enter_context(claimed_ports())
            yield from range(block, block + PORTS_PER_BLOCK - 1)

    def close(self) -> None:
        self._blocks.close()

    def start_naming(self) -> None:
        self.naming = self._launch(*naming_service_command(Address("127.0.0.1", self.port), self.folder))

    def address(self, name: str) -> str:
        if name not in self._port_of:
            self._port_of[name] = next(self._ports)
        return f"127.0.0.1:{self._port_of[name]}"

    def spawn(self, name: str, *more: str, module: str = SERVER, **environment: str) -> None:
        """Start or restart a channel; does not wait until it is ready. module: what runs."""
        where = ("--state", str(self.folder / name), "--endpoint", self.address(name))
        naming = ("--naming", f"127.0.0.1:{self.port}", "--name", name)
        command = (*module_command(module), *where, *naming, *more)
        if name in self._relays:
            environment["ORBendPointPublish"] = f"giop:tcp:127.0.0.1:{self._relay_port(name)}"
        self.processes[name] = self._launch(*command, **environment)

    def _relay(self, name: str) -> Relay:
        target = int(self.address(name).rpartition(":")[2])
        return Relay(self._relay_port(name), target, lambda port: self._is_cut(name, port))

    @contextlib.contextmanager
    def behind_relays(self, *names: str) -> Iterator[None]:
        """Start channels whose links can be cut."""
        with contextlib.ExitStack() as stack:
            for name in names:
                self._relays[name] = stack.enter_context(self._relay(name))
            self.start(*names)
            yield

    def cut(self, link: str) -> None:
        """Cut a link (such as "AB") between channels behind relays: its ends can't call each other."""
        self._cut.add(frozenset(link))
        for name in link:
            self._relays[name].end_refused()

    def restore(self, link: str) -> None:
        self._cut.discard(frozenset(link))

    def _is_cut(self, name: str, port: int) -> bool:
        """Whether the client of this local port is a channel whose link with `name` is cut."""
        pids = {self.processes[other].pid for link in self._cut if name in link for other in link - {name}}
        if not pids:
            return False
        ends = [(each.laddr, each.pid) for each in psutil.net_connections("tcp4")]
        return any(address and address.port == port and pid in pids for address, pid in ends)

    def _relay_port(self, name: str) -> int:
        return int(self.address(f"relay of {name}").rpartition(":")[2])

    def start(self, *names: str) -> None:
        for name in names:
            self.spawn(name)
        for name in names:
            self.wait_ready(name)
            self.clients[name] = EventClient(self.orb, name, name, timeout_s=LIMIT_S)

    def wait_ready(self, name: str) -> None:
        eventually(lambda: self.answers(name), LIMIT_S, f"channel {name}")

    def answers(self, name: str) -> bool:
        try:
            return bool(self.channel(name)._get_name() == name)
        except CORBA.SystemException:
            return False

    def kill(self, name: str) -> None:
        self.processes[name].send_signal(signal.SIGKILL)
        self.processes[name].wait(60.0)

    def kill_naming(self) -> None:
        assert self.naming
        self.naming.send_signal(signal.SIGKILL)
        self.naming.wait(60.0)

    def restart(self, *names: str) -> None:
        """Kill channels and start them again."""
        for name in names:
            self.kill(name)
            self.spawn(name)
        for name in names:
            self.wait_ready(name)

    @contextlib.contextmanager
    def stopped(self, name: str) -> Iterator[None]:
        """A channel whose process hangs (SIGSTOP)."""
        hang(self.processes[name].pid)
        try:
            yield
        finally:
            self.processes[name].send_signal(signal.SIGCONT)

    # ---- states of channels ----

    def channel(self, name: str) -> Any:
        return self.orb.reference(
            f"corbaloc:iiop:1.2@{self.address(name)}/EventChannels/{name}", RoboCorba.EventChannel
        )

    def links(self, name: str) -> dict[tuple[str, Any], Any]:
        """LinkStates by peer and direction."""
        return {(link.peer, link.direction): link for link in self.channel(name).state().links}

    def outgoing(self, name: str, peer: str) -> Any:
        return self.links(name)[peer, RoboCorba.OUTGOING]

    def incoming(self, name: str, peer: str) -> Any:
        return self.links(name)[peer, RoboCorba.INCOMING]

    def is_up(self, *pairs: str) -> bool:
        """Whether the links (such as "AB") are up in both directions and at both ends."""
        try:
            states = {name: self.links(name) for name in {end for pair in pairs for end in (pair[0], pair[1])}}
        except CORBA.SystemException:
            return False
        ends = [(a, b) for pair in pairs for a, b in ((pair[0], pair[1]), (pair[1], pair[0]))]
        return all(
            (b, direction) in states[a] and states[a][b, direction].condition == RoboCorba.UP
            for a, b in ends
            for direction in (RoboCorba.INCOMING, RoboCorba.OUTGOING)
        )

    # ---- the federation ----

    def shape(self, *pairs: str) -> None:
        """Replace all links by these, each requested at one end only; wait until all are up."""
        for name in self.clients:
            for peer in self.channel(name).peers():
                with contextlib.suppress(RoboCorba.UnknownPeer):
                    self.channel(name).removePeer(peer.name)
        for a, b in map(tuple, pairs):
            self.channel(a).addPeer(RoboCorba.PeerAddress(b, "", False))
        eventually(lambda: self.is_up(*pairs), LIMIT_S, f"links {' '.join(pairs)}")

    def wait_reaches(self, consumers: Mapping[str, Consumer], origins: str) -> None:
        """Wait until events pushed at each origin reach the consumers at all other channels, which see the probes."""
        routes = [(origin, there) for there in consumers for origin in origins if origin != there]
        deadline = time.monotonic() + LIMIT_S
        while routes:
            assert time.monotonic() < deadline, f"no events arrive on {routes}"
            probe = next(self._probes)
            for origin in {origin for origin, _ in routes}:
                self.clients[origin].push("probe", probe)
            time.sleep(0.1)
            routes = [
                (origin, there) for origin, there in routes if probe not in consumers[there].payloads(origin, "probe")
            ]

    def check_links(self, *pairs: str) -> None:
        """Check that every link's account is exact, and that one end received what the other delivered."""
        for a, b in [(pair[at], pair[1 - at]) for pair in pairs for at in (0, 1)]:

            def agree(a: str = a, b: str = b) -> bool:
                sent, received = self.outgoing(a, b), self.incoming(b, a)
                assert Counts.of(sent.events).is_exact and Counts.of(received.events).is_exact
                is_all = sent.events.delivered == received.events.received + received.repeated
                # A link that was joined again sends what was not acknowledged in other batches.
                same = received.repeated > 0 or (sent.batches, sent.bytes) == (received.batches, received.bytes)
                return not sent.events.queued and is_all and same

            eventually(agree, LIMIT_S, f"the same counts at both ends of {a}{b}")


@contextlib.contextmanager
def channels(folder: Path, *names: str) -> Iterator[Channels]:
    """A naming service and these channels, without links."""
    with (
        claimed_ports() as port,
        Launcher(folder) as launch,
        Orb(Address("127.0.0.1", port), call_timeout_s=5.0) as orb,
        contextlib.closing(Channels(launch, folder, port, orb)) as result,
    ):
        result.start_naming()
        result.start(*names)
        yield result
