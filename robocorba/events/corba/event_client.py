"""A process's connection to the event channel of its sub-network.

    with Orb(naming=settings.naming) as orb, EventClient(orb, "lab", source="A") as events:
        events.subscribe(lambda event: print(event.type, event.payload), "robot.*")
        events.push("robot.state", {"x": 1.0, "y": 2.0})

A payload is any value that msgpack can encode: numbers, strings, bytes, lists, dicts. The payload of an event from a
plain CORBA client is the Python value of its `any`.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Hashable, Iterable, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import msgpack
import omniORB
from omniORB import CORBA

from robocorba.errors.events import Disconnected, InvalidEvent, Unconfirmed
from robocorba.errors.services import NotReachable
from robocorba.events.corba import events
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import MAX_CLAUSES, Subscription, checked
from robocorba.orb.bounded_any import TC_ANY
from robocorba.orb.calls import describe
from robocorba.orb.exceptions import domain_error
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.backoff import Backoff
from robocorba.system.names import CHANNELS
from robocorba.system.repeating import Repeating

#: Default time for which a push is retried while the channel is not reachable [s].
RETRY_S = 10.0
#: How many of the channel's last calls a consumer recognises when they are repeated.
REMEMBERED_CALLS = 1000
#: Pauses between the attempts of a push.
BACKOFF = Backoff(0.02, 0.25)

_log = logging.getLogger(__name__)


class Event(NamedTuple):
    """An event as a consumer receives it. time: s since 1970. expiry: s after that, 0 for never. origin: the channel
    that received it first, number: its count there; empty and 0 for an event of OMG's plain push."""

    type: str
    source: str
    payload: Any
    time: float
    origin: str
    number: int
    priority: int = 0
    expiry: float = 0.0


class EventClient:
    """A connection to channel `channel`. source: the source of the events that it pushes; if it is not empty, also the
    name of a permanent proxy, by which the channel knows this supplier again.

    channel_at: its reference, if it is known. With an ORB of the options OFFER_CALLBACKS the channel calls this process
    over the connection that it has opened, so that it may be behind NAT or a firewall. Raises NotReachable if the
    channel is not found within `timeout_s`."""

    def __init__(
        self, orb: Orb, channel: str, source: str = "", timeout_s: float = 10.0, channel_at: Any = None
    ) -> None:
        self.channel = channel_at or orb.resolve(f"{CHANNELS}/{channel}", RoboCorba.EventChannel, timeout_s)
        self.source = self._proxy_name = source
        self._orb = orb
        self._proxy: Any = None
        self._subscriptions: list[EventSubscription] = []
        #: Renews the route of the channel's calls, for a client behind NAT.
        self._route: Repeating | None = None

    def __enter__(self) -> EventClient:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def push(
        self, type: str, payload: Any, *, priority: int = 0, expiry_s: float = 0.0, retry_s: float = RETRY_S
    ) -> None:
        """Publish one event. Retries for `retry_s` while the channel is not reachable.

        Raises InvalidEvent; NotReachable if the channel has not received the event; Unconfirmed if it may have."""
        header = self._header(type, priority, expiry_s)
        event = RoboCorba.Event(header, _packed(payload))
        self._call(header, lambda: self._proxy_consumer().pushEvent(event), retry_s)

    def push_many(
        self, type: str, payloads: Iterable[Any], *, priority: int = 0, expiry_s: float = 0.0, retry_s: float = RETRY_S
    ) -> None:
        """Publish events of one type in one call, in order. Raises the errors of `push`."""
        packed = [_packed(payload) for payload in payloads]
        header = self._header(type, priority, expiry_s)
        run = RoboCorba.EventRun(header, [0.0] * len(packed), packed)
        self._call(header, lambda: self._proxy_consumer().pushRuns([run]), retry_s)

    def push_any(self, type: str, value: Any, *, expiry_s: float = 0.0, retry_s: float = RETRY_S) -> None:
        """Publish an event that holds a CORBA.Any, for consumers in other languages. Raises the errors of `push`."""
        header = self._header(type, 0, expiry_s)
        header.encoding = RoboCorba.CDR_ANY
        event = RoboCorba.Event(header, omniORB.cdrMarshal(CORBA.TC_any, value))
        self._call(header, lambda: self._proxy_consumer().pushEvent(event), retry_s)

    def subscribe(
        self,
        receive: Callable[[Event], None],
        *patterns: str | tuple[str, str],
        name: str = "",
        queue: QueuePolicy | None = None,
    ) -> EventSubscription:
        """Call `receive` with each event that matches any of `patterns`: a type, or a type and a source, with wildcards
        * and ?. Without patterns: with every event.

        The calls are made one after another, in a thread of the ORB. A `name` makes the subscription durable: events
        that arrive while this process is away wait for the next process that subscribes by this name. Raises
        InvalidSubscription, InvalidQueue, NotReachable."""
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
        """Call `receive` with one event for each of `patterns`, made at most `window_s` apart (0: no limit)."""
        clauses = checked([([_pair(pattern) for pattern in patterns], window_s)])
        return self._subscribe(clauses, lambda event: receive([event]), lambda _, found: receive(found), name, queue)

    def subscribe_pairs(
        self, receive: Callable[[Sequence[Event]], None], type: str, sources: Sequence[str], window_s: float = 0.0
    ) -> list[EventSubscription]:
        """Call `receive` with two events of `type`, one from each of any two of `sources`, made at most `window_s`
        apart. These are several subscriptions where the pairs are more than the clauses that one may have."""
        pairs, made = list(combinations(sources, 2)), []
        for start in range(0, len(pairs), MAX_CLAUSES):
            some = pairs[start : start + MAX_CLAUSES]
            clauses = checked([([(type, source) for source in pair], window_s) for pair in some])
            queue = QueuePolicy(size=100)  # also of the events that wait for their counterpart
            made.append(self._subscribe(clauses, lambda event: None, lambda _, found: receive(found), "", queue))
        return made

    def close(self) -> None:
        """End all subscriptions; durable ones collect events for the next process."""
        if self._route:
            self._route.close()
        for subscription in self._subscriptions[:]:
            subscription.end()
        if self._proxy and not self._proxy_name:  # a named proxy is permanent, and possibly shared
            try:
                self._proxy.disconnect_push_consumer()
            except CORBA.Exception as error:
                _log.info("could not disconnect a supplier from the channel (%s)", describe(error))
            self._proxy = None

    def _subscribe(
        self,
        clauses: Subscription,
        receive: Callable[[Event], None],
        receive_together: Callable[[int, Sequence[Event]], None],
        name: str,
        queue: QueuePolicy | None,
    ) -> EventSubscription:
        consumer = _EventConsumerServant(receive, receive_together)
        reference = self._orb.activate(consumer)
        policy = events.policy(queue or QueuePolicy())
        try:
            self._keep_route(reference)
            proxy = self.channel.subscribe(name, reference, events.subscription(clauses), policy)
        except (CORBA.Exception, NotReachable) as error:
            self._orb.deactivate(consumer)
            raise (error if isinstance(error, NotReachable) else _translated(error)) from None
        subscription = EventSubscription(self, self._orb, consumer, proxy, reference)
        self._subscriptions.append(subscription)
        if self._orb.offers_callbacks and self._route is None:
            # Short enough for any NAT, and for a restarted channel to find its consumers before it disconnects them.
            self._route = Repeating("route", self._keep_routes, 5.0).start()
        return subscription

    def _keep_routes(self) -> None:
        """Renew the routes of all subscriptions."""
        try:
            for subscription in self._subscriptions[:]:
                self._keep_route(subscription.consumer_reference)
        except (CORBA.Exception, NotReachable) as error:  # the channel is away; the next time it may be back
            _log.info("could not renew the route of the channel's calls (%s)", describe(error))

    def _keep_route(self, consumer: Any) -> None:
        """Let the channel call a consumer over this client's connection, if the ORB offers that."""
        if not self._orb.offers_callbacks:
            return
        route = self.channel.routeBack()
        if route is None:
            raise NotReachable(
                "the channel calls no consumers behind NAT: start it with `robocorba up --bidirectional`"
            )
        route.keep(consumer)

    def _header(self, type: str, priority: int, expiry_s: float) -> Any:
        """The channel sets the time: the clock of this system may be wrong."""
        return RoboCorba.EventHeader(type, self.source, "", 0, 0.0, priority, expiry_s, RoboCorba.MSGPACK)

    def _proxy_consumer(self) -> Any:
        if self._proxy is None:
            self._proxy = self.channel.supply(self._proxy_name)
        return self._proxy

    def _call(self, header: Any, operation: Callable[[], None], retry_s: float) -> None:
        """Push; what expires before the channel is reachable is dropped."""
        began, expiry_s = time.monotonic(), header.expiry

        def attempt() -> None:
            waited_s = time.monotonic() - began
            if expiry_s > 0.0 and waited_s > 0.01:  # the first attempt leaves the event the whole time
                header.expiry = expiry_s - waited_s
                if header.expiry <= 0.0:
                    return
            _push(operation)

        try:
            try:
                BACKOFF.call(attempt, retry_s, CORBA.TRANSIENT, CORBA.COMM_FAILURE)
            except (CORBA.OBJECT_NOT_EXIST, Disconnected):  # another client of this name has ended the shared proxy
                self._proxy = None
                _push(operation)
        except CORBA.SystemException as error:
            raise NotReachable(f"the channel does not accept events ({describe(error)})") from None


def _push(operation: Callable[[], None]) -> None:
    """Raises a CORBA.SystemException only if the channel has not received the event."""
    try:
        operation()
    except CORBA.UserException as error:
        raise (domain_error(error) or error) from None
    except CORBA.SystemException as error:
        if error.completed == CORBA.COMPLETED_NO:
            raise
        reason = f"no answer from the channel, which may have received the event ({describe(error)})"
        raise Unconfirmed(reason) from None


class EventSubscription:
    """A consumer of this process, connected to its channel by `proxy`."""

    def __init__(
        self, client: EventClient, orb: Orb, consumer: _EventConsumerServant, proxy: Any, consumer_reference: Any
    ) -> None:
        self.proxy, self.consumer_reference = proxy, consumer_reference
        self._client, self._orb, self._consumer = client, orb, consumer

    def change(self, *patterns: str | tuple[str, str]) -> None:
        """Replace the subscription by these patterns, as `subscribe` takes them. Raises InvalidSubscription,
        NotReachable."""
        wanted = events.subscription(checked([([_pair(pattern)], 0.0) for pattern in patterns or ("*",)]))
        try:
            self.proxy.changeSubscription(wanted)
        except CORBA.Exception as error:
            raise _translated(error) from None

    def is_lost(self) -> bool:
        """Whether the channel has ended it, as it does after many failed calls of the consumer. False if the channel
        does not answer."""
        try:
            return bool(self.proxy._non_existent())
        except CORBA.OBJECT_NOT_EXIST:
            return True
        except CORBA.SystemException:
            return False

    def discarded(self) -> int:
        """How many events the channel has discarded that waited for this consumer. Raises EventError,
        NotReachable."""
        try:
            return int(self.proxy.state().events.discarded)
        except CORBA.Exception as error:
            raise _translated(error) from None

    def wait_in_force(self, peer: str, timeout_s: float = 5.0) -> bool:
        """Wait until the channel `peer` forwards the events of this subscription; False after `timeout_s`.

        Raises UnknownPeer, NotReachable."""
        try:
            return Backoff(0.02, 0.02).poll(lambda: bool(self.proxy.isInForceAt(peer)), timeout_s)
        except CORBA.Exception as error:
            raise _translated(error) from None

    def end(self) -> None:
        """Stop receiving. A durable subscription keeps collecting until the channel's `unsubscribe`."""
        if self not in self._client._subscriptions:
            return
        self._client._subscriptions.remove(self)
        try:
            self.proxy.disconnect_push_supplier()
        except CORBA.Exception as error:  # the channel is away; it finds out by its first call
            _log.info("could not disconnect a consumer from the channel (%s)", describe(error))
        self._orb.deactivate(self._consumer)


def _translated(error: CORBA.Exception) -> Exception:
    """The domain error for an exception of the channel."""
    return domain_error(error) or NotReachable(f"the channel does not answer ({describe(error)})")


class _EventConsumerServant(RoboCorba__POA.IdempotentEventConsumer):
    """The servant that the channel calls. An exception of the receiver is logged, and affects no other event."""

    def __init__(self, receive: Callable[[Event], None], receive_together: Callable[[int, list[Event]], None]) -> None:
        self._receive, self._receive_together = receive, receive_together
        self._lock = threading.Lock()  # one call after another, also if an earlier call of the channel timed out
        #: What identifies the last calls, oldest first: a repeated one is ignored.
        self._known: dict[Hashable, None] = {}

    def push(self, value: Any) -> None:
        batch = events.batch_of_any(value)
        event = Event(batch.header.type, batch.header.source, value.value(), batch.times[0], "", 0)
        with self._lock:
            self._guard(self._receive, event)

    def pushRuns(self, runs: Any) -> None:
        with self._lock:
            if not runs:
                return
            first, last = runs[0], runs[-1].first
            call = (first.first.origin, first.first.number, *first.times[:1], last.origin, last.number, len(runs))
            if self._is_repeated(call):
                return
            for run in runs:
                header = run.first
                for place, payload in enumerate(run.payloads):
                    self._guard(self._receive, _event(header, payload, run.times[place], header.number + place))

    def pushTogether(self, which: int, found: Any) -> None:
        together = [_event(one.header, one.payload, one.header.time, one.header.number) for one in found]
        with self._lock:
            if not self._is_repeated((which, *((event.origin, event.number, event.time) for event in together))):
                self._guard(self._receive_together, which, together)

    def _is_repeated(self, call: Hashable) -> bool:
        """Whether the channel has made this call before; remembers it otherwise."""
        if call in self._known:
            return True
        self._known[call] = None
        if len(self._known) > REMEMBERED_CALLS:
            del self._known[next(iter(self._known))]
        return False

    def disconnect_push_consumer(self) -> None:
        _log.info("the channel has disconnected a consumer")

    @staticmethod
    def _guard(receive: Callable[..., None], *arguments: Any) -> None:
        try:
            receive(*arguments)
        except Exception:  # raised by user code; later events must still be delivered
            _log.exception("the receiver of an event raised an exception")


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
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidEvent("payload", f"cannot be encoded by msgpack: {error}") from None
    return packed


def _unpacked(encoding: Any, payload: bytes) -> Any:
    """The decoded payload; the bytes themselves if they cannot be decoded."""
    try:
        if encoding == RoboCorba.CDR_ANY:
            return omniORB.cdrUnmarshal(TC_ANY, payload).value()
        return msgpack.unpackb(payload, strict_map_key=False)
    except (CORBA.SystemException, ValueError, msgpack.UnpackException):
        return payload


def _pair(pattern: str | tuple[str, str]) -> tuple[str, str]:
    return (pattern, "") if isinstance(pattern, str) else pattern
