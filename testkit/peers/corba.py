"""CORBA event channels: ours by each of its interfaces, and omniEvents.

PLAIN is OMG's interface, with one `any` a call at both ends. HEADER pushes Event structs, and its consumer takes
batches. CLIENT is robocorba.events.corba.event_client at both ends: what a Python program uses."""

from __future__ import annotations

import contextlib
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

import CosEventChannelAdmin
import CosEventComm__POA
from omniORB import CORBA

from robocorba.events.corba import events
from robocorba.events.corba.event_client import EventClient
from robocorba.events.queue import OverflowRule, QueuePolicy
from robocorba.events.subscription import ALL
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.settings import Address
from robocorba.system.supervision.launch import module_command
from robocorba.system.supervision.system import find_omninames
from testkit.peers.base import (
    PAYLOAD_BYTES,
    START_LIMIT_S,
    Broker,
    Peer,
    Receive,
    Start,
    Supplier,
    free_ports,
    program,
)
from testkit.processes import eventually

CHANNEL, TYPE, SOURCE = "bench", "bench.event", "A"
#: Lossless: a full queue blocks the supplier.
LOSSLESS = QueuePolicy(20_000, OverflowRule.BLOCK_SUPPLIER, 10.0)
#: Period of the channel of omniEvents; its default of 100 ms would not be comparable.
CYCLE_NS = 1000

#: Connects to an address: an ORB of this process, and the channel.
Connect = Callable[[str], AbstractContextManager[tuple[Orb, Any]]]
#: Connects a receiver to a channel; returns the call that disconnects it.
Consume = Callable[[Orb, Any, Receive], Callable[[], object]]


class PlainConsumer(CosEventComm__POA.PushConsumer):
    """Takes one `any` a call."""

    def __init__(self, receive: Receive) -> None:
        self._receive = receive

    def push(self, value: Any) -> None:
        self._receive((value.value(),))

    def disconnect_push_consumer(self) -> None:
        pass


class BatchConsumer(RoboCorba__POA.EventConsumer):
    """Takes the last `size` bytes of the payloads of runs of events."""

    def __init__(self, receive: Receive, size: int = 0) -> None:
        self._receive, self._size = receive, size

    def push(self, value: Any) -> None:
        raise CORBA.NO_IMPLEMENT(0, CORBA.COMPLETED_NO)

    def pushRuns(self, runs: Any) -> None:
        for run in runs:
            self._receive([payload[-self._size :] for payload in run.payloads] if self._size else run.payloads)

    def pushTogether(self, which: int, found: Any) -> None:
        raise CORBA.NO_IMPLEMENT(0, CORBA.COMPLETED_NO)

    def disconnect_push_consumer(self) -> None:
        pass


def consume_plain(orb: Orb, channel: Any, receive: Receive) -> Callable[[], object]:
    proxy = channel.for_consumers().obtain_push_supplier()
    proxy.connect_push_consumer(orb.activate(PlainConsumer(receive)))
    return partial(proxy.disconnect_push_supplier)


def consume_batches(orb: Orb, channel: Any, receive: Receive, size: int = 0) -> Callable[[], object]:
    """size: for events of plain suppliers. Their payload is the CDR encapsulation of the `any`, which ends with the
    stamp."""
    consumer = orb.activate(BatchConsumer(receive, size))
    proxy = channel.subscribe("", consumer, events.subscription(ALL), events.policy(LOSSLESS))
    return partial(proxy.disconnect_push_supplier)


def consume_by_client(orb: Orb, _: Any, receive: Receive) -> Callable[[], object]:
    client = EventClient(orb, CHANNEL)
    client.subscribe(lambda event: receive((event.payload,)), queue=LOSSLESS)
    return client.close


@contextlib.contextmanager
def plain_supplier(connect: Connect, address: str) -> Iterator[Supplier]:
    with connect(address) as (_, channel):
        proxy = channel.for_suppliers().obtain_push_consumer()
        proxy.connect_push_supplier(None)
        octets = RoboCorba._tc_Octets
        yield Supplier(lambda payload: proxy.push(CORBA.Any(octets, payload)))
        with contextlib.suppress(CORBA.Exception):
            proxy.disconnect_push_consumer()


@contextlib.contextmanager
def header_supplier(connect: Connect, address: str) -> Iterator[Supplier]:
    def header() -> Any:
        return RoboCorba.EventHeader(TYPE, SOURCE, "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK)

    def push_run(payloads: Sequence[bytes]) -> None:
        proxy.pushRuns([RoboCorba.EventRun(header(), [time.time()] * len(payloads), payloads)])

    with connect(address) as (_, channel):
        proxy = channel.supply("")
        yield Supplier(lambda payload: proxy.pushEvent(RoboCorba.Event(header(), payload)), push_run)
        with contextlib.suppress(CORBA.Exception):
            proxy.disconnect_push_consumer()


@contextlib.contextmanager
def client_supplier(connect: Connect, address: str) -> Iterator[Supplier]:
    with connect(address) as (orb, _), EventClient(orb, CHANNEL, SOURCE) as client:
        yield Supplier(partial(client.push, TYPE), partial(client.push_many, TYPE))


@contextlib.contextmanager
def consumers(connect: Connect, consume: Consume, address: str, *receivers: Receive) -> Iterator[None]:
    """As many consumers in this process as there are receivers."""
    with connect(address) as (orb, channel):
        ends = [consume(orb, channel, receive) for receive in receivers]
        yield
        for end in ends:
            with contextlib.suppress(CORBA.Exception):
                end()


# ---- ours ----


def start_channel(start: Start, folder: Path, before: Sequence[str] = ()) -> Broker:
    """A channel in a process of its own. Address: that of its naming service. before: prefix of its command."""
    naming, (port,) = naming_service(start, folder), free_ports(1)
    where = ("--state", str(folder / f"channel-{port}"), "--endpoint", f"127.0.0.1:{port}")
    command = module_command("robocorba.servers.event_channel")
    return Broker(naming, start(*before, *command, *where, "--naming", naming, "--name", CHANNEL))


def naming_service(start: Start, folder: Path) -> str:
    """HOST:PORT of a naming service of its own."""
    (port,) = free_ports(1)
    data = folder / f"names-{port}"
    data.mkdir()
    endpoint = ("-ORBendPoint", f"giop:tcp:127.0.0.1:{port}")
    start(find_omninames(), "-start", str(port), "-always", "-nohostname", "-datadir", str(data), *endpoint)
    return f"127.0.0.1:{port}"


@contextlib.contextmanager
def connected(address: str) -> Iterator[tuple[Orb, Any]]:
    with Orb(Address.parse(address)) as orb:
        yield orb, orb.resolve(f"EventChannels/{CHANNEL}", RoboCorba.EventChannel, START_LIMIT_S)


def ours(name: str, supplier: Callable[..., Any], consume: Consume, before: Sequence[str] = ()) -> Peer:
    return Peer(
        f"ours, {name}",
        partial(start_channel, before=before),
        partial(supplier, connected),
        partial(consumers, connected, consume),
        programs=before[:1],
    )


PLAIN = ours("plain", plain_supplier, consume_plain)
PLAIN_TO_BATCHES = ours("plain to batches", plain_supplier, partial(consume_batches, size=PAYLOAD_BYTES))
HEADER = ours("header", header_supplier, consume_batches)
ON_ONE_CORE = ours("header, on one core", header_supplier, consume_batches, ("taskset", "-c", "0"))
CLIENT = ours("EventClient", client_supplier, consume_by_client)


# ---- omniEvents ----


def start_omnievents(start: Start, folder: Path) -> Broker:
    (port,), state = free_ports(1), folder / "omniEvents"
    state.mkdir()
    naming = ("-ORBInitRef", f"NameService=corbaloc::{naming_service(start, folder)}/NameService")
    where = ("-p", str(port), "-l", str(state), "-t", str(state / "trace"))
    pid = start(program("omniEvents"), "-f", *where, *naming)
    factory = f"corbaloc::127.0.0.1:{port}/omniEvents"
    make = (program("eventc"), "-n", "bench", "-i", "bench", "-c", str(CYCLE_NS), *naming, factory)
    eventually(lambda: not subprocess.run(make, capture_output=True, timeout=10).returncode, START_LIMIT_S, "a channel")
    return Broker(f"corbaloc::127.0.0.1:{port}/bench", pid)


@contextlib.contextmanager
def omnievents_channel(address: str) -> Iterator[tuple[Orb, Any]]:
    with Orb(Address("127.0.0.1", 1)) as orb:  # without a naming service: port 1 is unused
        yield orb, orb.reference(address, CosEventChannelAdmin.EventChannel)


OMNIEVENTS = Peer(
    "omniEvents, tuned",
    start_omnievents,
    partial(plain_supplier, omnievents_channel),
    partial(consumers, omnievents_channel, consume_plain),
    programs=["omniEvents", "eventc"],
)
