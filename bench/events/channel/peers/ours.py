"""The channel of this project, by each of its interfaces.

PLAIN is OMG's, with one `any` a call at both ends. HEADER pushes Event structs, and its consumer takes batches.
CLIENT is robocorba.corba.event_client at both ends: what a Python program uses.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from omniORB import CORBA

from bench.events.channel.peers.base import Broker, OneByOne, Receive, Start, free_port, lacking, split
from bench.events.channel.peers.cos import PlainConsumer, PlainSupplier
from bench.events.channel.peers.stamps import SIZE
from robocorba.corba.conversion import events
from robocorba.corba.event_client import Event, EventClient
from robocorba.corba.orb import Orb
from robocorba.events.queue import OverflowRule, QueuePolicy
from robocorba.events.subscription import ALL
from robocorba.settings import Address
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.supervision.launch import module_command
from robocorba.supervision.system import naming_service_command

CHANNEL, TYPE, SOURCE = "bench", "bench.event", "A"
#: Lossless: a full queue blocks the supplier.
LOSSLESS = QueuePolicy(20_000, OverflowRule.BLOCK_SUPPLIER, 10.0)
#: Queue size of a consumer of BOUNDED [events]; beyond it the oldest are discarded.
BOUND = 500
_START_LIMIT_S = 20.0


class HeaderSupplier(OneByOne):
    """Pushes Event structs, or runs of them."""

    def __init__(self, channel: Any, name: str = "") -> None:
        self._proxy = channel.supply(name)

    def push(self, payload: bytes) -> None:
        header = RoboCorba.EventHeader(TYPE, SOURCE, "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK)
        self._proxy.pushEvent(RoboCorba.Event(header, payload))

    def push_run(self, payloads: Sequence[bytes]) -> None:
        header = RoboCorba.EventHeader(TYPE, SOURCE, "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK)
        self._proxy.pushRuns([RoboCorba.EventRun(header, [time.time()] * len(payloads), payloads)])

    def close(self) -> None:
        self._proxy.disconnect_push_consumer()


class BatchConsumer(RoboCorba__POA.EventConsumer):
    """Takes runs of events. proxy: the proxy that serves it."""

    def __init__(self, orb: Orb, channel: Any, receive: Receive, policy: QueuePolicy = LOSSLESS) -> None:
        self._receive = receive
        wanted = events.subscription(ALL)
        self.proxy = channel.subscribe("", orb.activate(self), wanted, events.policy(policy))

    def push(self, value: Any) -> None:
        raise CORBA.NO_IMPLEMENT(0, CORBA.COMPLETED_NO)

    def pushRuns(self, runs: Any) -> None:
        for run in runs:
            self._receive(run.payloads)

    def pushTogether(self, which: int, found: Any) -> None:
        raise CORBA.NO_IMPLEMENT(0, CORBA.COMPLETED_NO)

    def disconnect_push_consumer(self) -> None:
        pass

    def close(self) -> None:
        self.proxy.disconnect_push_supplier()


class AnyBatchConsumer(BatchConsumer):
    """For events of plain suppliers. Their payload is the CDR encapsulation of the `any`, which ends with the stamp."""

    def pushRuns(self, runs: Any) -> None:
        for run in runs:
            self._receive([payload[-SIZE:] for payload in run.payloads])


class ClientSupplier(OneByOne):
    """Pushes by an EventClient."""

    def __init__(self, orb: Orb) -> None:
        self._client = EventClient(orb, CHANNEL, SOURCE)

    def push(self, payload: bytes) -> None:
        self._client.push(TYPE, payload)

    def push_run(self, payloads: Sequence[bytes]) -> None:
        self._client.push_many(TYPE, payloads)

    def close(self) -> None:
        self._client.close()


class ClientConsumer:
    """Receives by an EventClient."""

    def __init__(self, orb: Orb, receive: Receive) -> None:
        self._client = EventClient(orb, CHANNEL)
        self._receive = receive
        self._client.subscribe(self._take, queue=LOSSLESS)

    def _take(self, event: Event) -> None:
        self._receive((event.payload,))

    def close(self) -> None:
        self._client.close()


class Ours:
    """supply, consume: make the supplier and the consumer. before: prefix of the command that starts the channel."""

    batches = True

    def __init__(
        self,
        name: str,
        batches: bool,
        supply: Callable[[Orb, Any], Any],
        consume: Callable[[Orb, Any, Receive], Any],
        before: Sequence[str] = (),
    ) -> None:
        self.name, self.batches = name, batches
        self._supply, self._consume, self._before = supply, consume, before

    def missing(self) -> str:
        return lacking(programs=self._before[:1])

    @contextlib.contextmanager
    def broker(self, folder: Path, start: Start) -> Iterator[Broker]:
        yield start_channel(folder, start, self._before)

    @contextlib.contextmanager
    def supplier(self, address: str) -> Iterator[Any]:
        with connected(address) as (orb, channel):
            supplier = self._supply(orb, channel)
            yield supplier
            with contextlib.suppress(CORBA.Exception):
                supplier.close()

    @contextlib.contextmanager
    def consumer(self, address: str, *receivers: Receive) -> Iterator[None]:
        """As many consumers in this process as there are receivers."""
        with connected(address) as (orb, channel):
            consumers = [self._consume(orb, channel, receive) for receive in receivers]
            yield
            for consumer in consumers:
                with contextlib.suppress(CORBA.Exception):
                    consumer.close()


def start_channel(folder: Path, start: Start, before: Sequence[str] = ()) -> Broker:
    """A channel in a process of its own, once it answers. Address: that of its naming service."""
    naming, endpoint = naming_service(folder, start), f"127.0.0.1:{free_port()}"
    state = folder / f"channel-{endpoint.rpartition(':')[2]}"
    where = ("--state", str(state), "--endpoint", endpoint, "--naming", naming, "--name", CHANNEL)
    return Broker(naming, start(*before, *module_command("robocorba.servers.event_channel"), *where))


def naming_service(folder: Path, start: Start) -> str:
    """HOST:PORT of a naming service of its own."""
    port = free_port()
    data = folder / f"names-{port}"
    data.mkdir()
    start(*naming_service_command(Address("127.0.0.1", port), data))
    return f"127.0.0.1:{port}"


@contextlib.contextmanager
def connected(address: str) -> Iterator[tuple[Orb, Any]]:
    """An ORB of this process, and the channel."""
    with Orb(Address(*split(address))) as orb:
        yield orb, orb.resolve(f"EventChannels/{CHANNEL}", RoboCorba.EventChannel, _START_LIMIT_S)


PLAIN = Ours("ours, plain", False, lambda _, channel: PlainSupplier(channel), PlainConsumer)
BOUNDED = Ours(
    "ours, bounded",
    True,
    lambda _, channel: HeaderSupplier(channel),
    lambda orb, channel, receive: BatchConsumer(orb, channel, receive, QueuePolicy(BOUND)),
)
PLAIN_TO_BATCHES = Ours("ours, plain to batches", False, lambda _, channel: PlainSupplier(channel), AnyBatchConsumer)
HEADER = Ours("ours, header", True, lambda _, channel: HeaderSupplier(channel), BatchConsumer)
ON_ONE_CORE = Ours(
    "ours, header, on one core", True, lambda _, channel: HeaderSupplier(channel), BatchConsumer, ("taskset", "-c", "0")
)
CLIENT = Ours(
    "ours, EventClient", True, lambda orb, _: ClientSupplier(orb), lambda orb, _, receive: ClientConsumer(orb, receive)
)
