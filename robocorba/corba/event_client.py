"""A process's connection to the event channel of its sub-network.

    with Orb(naming=settings.naming) as orb, EventClient(orb, "lab", source="A") as events:
        events.subscribe(lambda event: print(event.type, event.payload), "robot.*")
        events.push("robot.state", {"x": 1.0, "y": 2.0})

Payloads are whatever msgpack holds: numbers, strings, bytes, lists, dicts. What a plain CORBA client pushed
arrives with the Python value of its `any` as payload.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from types import TracebackType
from typing import Any, NamedTuple

import msgpack
import omniORB
from omniORB import CORBA

from robocorba.corba.calls import describe
from robocorba.corba.conversion import events
from robocorba.corba.conversion.errors import domain_error
from robocorba.corba.orb import Orb
from robocorba.errors.events import InvalidEvent, Unconfirmed
from robocorba.errors.services import NotReachable
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import Subscription, checked
from robocorba.names import CHANNELS
from robocorba.stubs import RoboCorba, RoboCorba__POA

#: A channel that is started again is waited for so long.
RETRY_S = 10.0
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.02, 0.25

_log = logging.getLogger(__name__)


class Event(NamedTuple):
    """An event as a consumer gets it: `time` in s since 1970, `expiry` in s after that (0: never)."""

    type: str
    source: str
    payload: Any
    time: float
    origin: str
    number: int
    priority: int = 0
    expiry: float = 0.0


class EventClient:
    """Connected to channel `channel`, in whose events `source` says who speaks.

    Raises NotReachable where the channel can't be found within `timeout_s`."""

    def __init__(self, orb: Orb, channel: str, source: str = "", timeout_s: float = 10.0) -> None:
        self.channel = orb.resolve(f"{CHANNELS}/{channel}", RoboCorba.EventChannel, timeout_s)
        self.source = self._name = source
        self._orb = orb
        self._proxy: Any = None
        self._subscriptions: list[EventSubscription] = []

    def __enter__(self) -> EventClient:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def push(
        self, type: str, payload: Any, *, priority: int = 0, expiry_s: float = 0.0, retry_s: float = RETRY_S
    ) -> None:
        """Say one thing. Tries again for `retry_s` while the channel is not there.

        Raises InvalidEvent; NotReachable where the channel does not have the event; Unconfirmed where it may have."""
        header = self._header(type, priority, expiry_s)
        event = RoboCorba.Event(header, _packed(payload))
        self._call(lambda: self._supplier().pushEvent(event), retry_s)

    def push_many(
        self,
        type: str,
        payloads: Iterable[Any],
        *,
        priority: int = 0,
        expiry_s: float = 0.0,
        retry_s: float = RETRY_S,
    ) -> None:
        """Say many things of one type in one call, in order. Raises as `push` does."""
        packed = [_packed(payload) for payload in payloads]
        now = time.time()
        run = RoboCorba.EventRun(self._header(type, priority, expiry_s), [now] * len(packed), packed)
        self._call(lambda: self._supplier().pushRuns([run]), retry_s)

    def subscribe(
        self,
        receive: Callable[[Event], None],
        *patterns: str | tuple[str, str],
        name: str = "",
        queue: QueuePolicy | None = None,
    ) -> EventSubscription:
        """Call `receive` with each event that fits any of `patterns`: a type, or a type and a source, with wildcards
        * and ?. None: every event.

        Calls come one after another, in a thread of the ORB. A `name` makes the subscription durable: events that come
        while this process is away wait for the next one that subscribes by this name. Raises InvalidSubscription,
        InvalidQueue, NotReachable."""
        clauses = checked([([_pair(pattern)], 0.0) for pattern in patterns or ("*",)])
        return self._subscribe(clauses, receive, lambda which, found: None, name, queue)

    def subscribe_together(
        self,
        receive: Callable[[Sequence[Event]], None],
        *patterns: str | tuple[str, str],
        window_s: float = 0.0,
        name: str = "",
        queue: QueuePolicy | None = None,
    ) -> EventSubscription:
        """Call `receive` whenever there is an event for each of `patterns`, made within `window_s` (0: no limit)."""
        clauses = checked([([_pair(pattern) for pattern in patterns], window_s)])
        return self._subscribe(clauses, lambda event: receive([event]), lambda _, found: receive(found), name, queue)

    def close(self) -> None:
        """End what `subscribe` began; durable subscriptions keep their events for the next process."""
        for subscription in self._subscriptions[:]:
            subscription.end()
        if self._proxy and not self._name:  # one with a name is its supplier's for good, and perhaps shared
            try:
                self._proxy.disconnect_push_consumer()
            except CORBA.Exception as wrong:
                _log.info("the channel was not told that a supplier left (%s)", describe(wrong))
            self._proxy = None

    def _subscribe(
        self,
        clauses: Subscription,
        receive: Callable[[Event], None],
        receive_together: Callable[[int, Sequence[Event]], None],
        name: str,
        queue: QueuePolicy | None,
    ) -> EventSubscription:
        consumer = _Consumer(receive, receive_together)
        reference = self._orb.activate(consumer)
        policy = events.policy(queue or QueuePolicy())
        try:
            proxy = self.channel.subscribe(name, reference, events.subscription(clauses), policy)
        except CORBA.Exception as wrong:
            self._orb.deactivate(consumer)
            raise _translated(wrong) from None
        subscription = EventSubscription(self, self._orb, consumer, proxy)
        self._subscriptions.append(subscription)
        return subscription

    def _header(self, type: str, priority: int, expiry_s: float) -> Any:
        return RoboCorba.EventHeader(type, self.source, "", 0, time.time(), priority, expiry_s, RoboCorba.MSGPACK)

    def _supplier(self) -> Any:
        if self._proxy is None:
            self._proxy = self.channel.supply(self._name)
        return self._proxy

    def _call(self, operation: Callable[[], None], retry_s: float) -> None:
        deadline, pause = time.monotonic() + retry_s, FIRST_PAUSE_S
        while True:
            try:
                return operation()
            except CORBA.UserException as wrong:
                raise (domain_error(wrong) or wrong) from None
            except CORBA.SystemException as wrong:
                if wrong.completed != CORBA.COMPLETED_NO:
                    raise Unconfirmed(f"the channel may have the event or not ({describe(wrong)})") from None
                if not isinstance(wrong, CORBA.TRANSIENT | CORBA.COMM_FAILURE) or time.monotonic() + pause > deadline:
                    raise NotReachable(f"the channel does not take events ({describe(wrong)})") from None
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE_S)


class EventSubscription:
    """A consumer of this process, connected to its channel by `proxy`."""

    def __init__(self, client: EventClient, orb: Orb, consumer: _Consumer, proxy: Any) -> None:
        self.proxy = proxy
        self._client, self._orb, self._consumer = client, orb, consumer

    def change(self, *patterns: str | tuple[str, str]) -> None:
        """Receive events that fit any of these from now on. Raises InvalidSubscription, NotReachable."""
        wanted = events.subscription(checked([([_pair(pattern)], 0.0) for pattern in patterns or ("*",)]))
        try:
            self.proxy.changeSubscription(wanted)
        except CORBA.Exception as wrong:
            raise _translated(wrong) from None

    def wait_in_force(self, peer: str, timeout_s: float = 5.0) -> bool:
        """Wait until the channel `peer` forwards what is subscribed to; whether it does.

        Raises UnknownPeer, NotReachable."""
        deadline = time.monotonic() + timeout_s
        try:
            while not self.proxy.isInForceAt(peer):
                if time.monotonic() > deadline:
                    return False
                time.sleep(FIRST_PAUSE_S)
        except CORBA.Exception as wrong:
            raise _translated(wrong) from None
        return True

    def end(self) -> None:
        """Receive nothing more. A durable subscription goes on collecting until `unsubscribe` of the channel."""
        if self not in self._client._subscriptions:
            return
        self._client._subscriptions.remove(self)
        try:
            self.proxy.disconnect_push_supplier()
        except CORBA.Exception as wrong:  # the channel is away; it will find nobody here
            _log.info("the channel was not told that a consumer left (%s)", describe(wrong))
        self._orb.deactivate(self._consumer)


def _translated(wrong: CORBA.Exception) -> Exception:
    """Ours for an exception of the channel."""
    return domain_error(wrong) or NotReachable(f"the channel does not answer ({describe(wrong)})")


class _Consumer(RoboCorba__POA.EventConsumer):
    """What the channel calls. A fault in the receiver is logged, and costs no other event."""

    def __init__(self, receive: Callable[[Event], None], receive_together: Callable[[int, list[Event]], None]) -> None:
        self._receive, self._receive_together = receive, receive_together
        self._lock = threading.Lock()  # one after another, also where the channel had lost its patience once

    def push(self, value: Any) -> None:
        run = events.run_of_any(value)
        self._guard(self._receive, Event(run.header.type, run.header.source, value.value(), run.times[0], "", 0))

    def pushRuns(self, runs: Any) -> None:
        with self._lock:
            for run in runs:
                header = run.first
                for place, payload in enumerate(run.payloads):
                    self._guard(self._receive, _event(header, payload, run.times[place], header.number + place))

    def pushTogether(self, which: int, found: Any) -> None:
        together = [_event(one.header, one.payload, one.header.time, one.header.number) for one in found]
        with self._lock:
            self._guard(self._receive_together, which, together)

    def disconnect_push_consumer(self) -> None:
        _log.info("the channel has disconnected a consumer")

    @staticmethod
    def _guard(receive: Callable[..., None], *arguments: Any) -> None:
        try:
            receive(*arguments)
        except Exception:  # whatever the user's own code raises: the next event must come all the same
            _log.exception("a receiver of events failed")


def _event(header: Any, payload: bytes, moment: float, number: int) -> Event:
    return Event(
        header.type,
        header.source,
        _unpacked(header.encoding, payload),
        moment,
        header.origin,
        number,
        header.priority,
        header.expiry,
    )


def _packed(payload: Any) -> bytes:
    try:
        packed: bytes = msgpack.packb(payload)
    except (TypeError, ValueError, OverflowError) as wrong:
        raise InvalidEvent("payload", f"msgpack can't hold it: {wrong}") from None
    return packed


def _unpacked(encoding: Any, payload: bytes) -> Any:
    """The value in a payload; the bytes as they are where they don't hold what they should."""
    try:
        if encoding == RoboCorba.CDR_ANY:
            return omniORB.cdrUnmarshal(CORBA.TC_any, payload).value()
        return msgpack.unpackb(payload, strict_map_key=False)
    except (CORBA.SystemException, ValueError, msgpack.UnpackException):
        return payload


def _pair(pattern: str | tuple[str, str]) -> tuple[str, str]:
    return (pattern, "") if isinstance(pattern, str) else pattern
