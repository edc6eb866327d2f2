"""Conversion of events, subscriptions and states of a channel.

An EventRun of the IDL is an EventBatch here. The IDL's batch, a sequence of runs, is a packet of a feed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

import CosEventChannelAdmin
import CosEventComm
import omniORB
from omniORB import CORBA

from robocorba.errors import events as errors
from robocorba.errors.events import InvalidEvent, InvalidPeer
from robocorba.events.account import Account, LinkEnd
from robocorba.events.channel import Channel
from robocorba.events.channel_store import Peer
from robocorba.events.event import (
    MAX_NAME,
    MAX_SECONDS,
    CorrelatedEvents,
    Encoding,
    EventBatch,
    EventHeader,
    check,
    checked_header,
)
from robocorba.events.federation import MAX_CHANNELS, Advertisement, check_name, is_name
from robocorba.events.links import Links
from robocorba.events.proxies import Proxies, ProxySnapshot
from robocorba.events.proxy import ProxyCondition, ProxyKind
from robocorba.events.queue import OverflowRule, QueuePolicy
from robocorba.events.subscription import Pattern, Subscription, checked
from robocorba.events.traffic import ChannelTraffic, OriginTraffic
from robocorba.orb.bounded_any import TC_ANY
from robocorba.orb.exceptions import register, register_system, register_with
from robocorba.orb.structs import Converter, enumeration, struct_converter
from robocorba.stubs import RoboCorba

#: By the value of the enumerator; hashing it would cost more than the rest of a header.
_ENCODING_OF = [Encoding.MSGPACK, Encoding.CDR_ANY]
_RULES = enumeration(OverflowRule)


class PlainPayload:
    """The `any` of a plain client, and its encoding."""

    __slots__ = ("encoded", "value")

    def __init__(self, value: Any) -> None:
        """Raises InvalidEvent for a value that omniORBpy has read, but could not send."""
        self.value = value
        try:
            self.encoded: bytes = omniORB.cdrMarshal(CORBA.TC_any, value)
        except (CORBA.SystemException, SystemError, TypeError, ValueError) as error:
            raise InvalidEvent("payload", f"can't be sent by omniORBpy: {error}") from None

    def __len__(self) -> int:
        return len(self.encoded)


# ---- received events ----


def batch_of_any(value: Any) -> EventBatch:
    """The event of a plain client: with its own header if it is an Event, else with Encoding.NATIVE.

    Raises InvalidEvent."""
    typecode = value._t
    try:
        type_name = typecode.id()
    except CORBA.TypeCode.BadKind:  # a type without a repository id
        type_name = str(typecode.kind()).rpartition("tk_")[2]
    if type_name == RoboCorba.Event._NP_RepositoryId:
        return batch_of_event(value._v)
    batch = EventBatch(_native_header(type_name), [0.0], [PlainPayload(value)])
    check(batch)
    return batch


@lru_cache(1024)
def _native_header(type_name: str) -> EventHeader:
    return checked_header(type_name[:MAX_NAME] or "any", "", 0, 0.0, Encoding.NATIVE)


def batch_of_foreign_any(value: Any) -> EventBatch:
    """The event of a foreign channel. An event from a channel of this federation keeps its origin and number.

    Raises InvalidEvent."""
    batch = batch_of_any(value)
    if batch.header.encoding is not Encoding.NATIVE:
        header = value._v.header
        if header.origin:
            batch.header = _with_origin(batch.header, header.origin)
        batch.first = header.number
    return batch


def batch_of_event(struct: Any) -> EventBatch:
    """The event of an Event struct. Raises InvalidEvent."""
    return _received(struct.header, [struct.header.time], [struct.payload])


def batch_of(struct: Any) -> EventBatch:
    """The events of an EventRun struct from a supplier. Raises InvalidEvent."""
    return _received(struct.first, struct.times, struct.payloads)


def _received(header: Any, times: Sequence[float], payloads: Sequence[bytes]) -> EventBatch:
    """Events of a client, with the origin and number that it has sent; those that it has received have some."""
    encoding = _ENCODING_OF[header.encoding._v]
    checked = checked_header(header.type, header.source, header.priority, header.expiry, encoding)
    batch = EventBatch(checked, times, payloads)
    check(batch)
    if header.origin and len(header.origin) <= MAX_NAME:
        batch.header, batch.first = batch.header._replace(origin=header.origin), header.number
    return batch


def forwarded_batch_of(struct: Any, epoch: float, way: Any) -> EventBatch:
    """The events of an EventRun struct from a peer, with origin and numbers. epoch: by the peer's clock. way: EventWay
    struct. Raises InvalidEvent."""
    batch = batch_of(struct)
    batch.header = _with_origin(batch.header, struct.first.origin)
    batch.first, batch.epoch = struct.first.number, epoch
    if not 0 < batch.first <= batch.last < 2**64:
        raise InvalidEvent("number", f"{batch.first} is out of range as the first of {len(batch)} events")
    if not -MAX_SECONDS <= epoch <= MAX_SECONDS:
        raise InvalidEvent("epoch", f"{epoch} is out of range")
    if len(way.targets) > MAX_CHANNELS:
        raise InvalidEvent("targets", f"{len(way.targets)} channels; at most {MAX_CHANNELS} are allowed")
    batch.targets, batch.hops = {_channel(target.channel): target.before for target in way.targets}, way.hops
    return batch


@lru_cache(4096)
def _channel(name: str) -> str:
    try:
        return check_name(name)
    except InvalidPeer as error:
        raise InvalidEvent("targets", error.reason) from None


@lru_cache(4096)
def _with_origin(header: EventHeader, origin: str) -> EventHeader:
    try:
        return header._replace(origin=check_name(origin))
    except InvalidPeer as error:
        raise InvalidEvent("origin", error.reason) from None


# ---- sent events ----


def event_run(batch: EventBatch) -> Any:
    """The EventRun struct; cached in the batch, which often goes to several consumers."""
    if batch.cached is None:
        batch.cached = RoboCorba.EventRun(_header(batch, 0.0), batch.times, _payloads(batch))
    return batch.cached


def event_runs(batches: Iterable[EventBatch]) -> list[Any]:
    """An EventRunSeq for a peer."""
    return [event_run(batch) for batch in batches]


def event_ways(batches: Iterable[EventBatch]) -> list[Any]:
    """An EventWaySeq for a peer."""
    return [
        RoboCorba.EventWay(
            [RoboCorba.EventTarget(name, before) for name, before in (batch.targets or {}).items()], batch.hops
        )
        for batch in batches
    ]


def event(batch: EventBatch) -> Any:
    """The first event of a batch, as an Event struct."""
    return RoboCorba.Event(_header(batch, batch.times[0]), _payloads(batch)[0])


def plain_event(batch: EventBatch) -> Any:
    """The first event of a batch for a plain consumer: its own `any` if there is one, else an `any` with an Event."""
    encoding = batch.header.encoding
    if encoding is Encoding.NATIVE:
        return batch.payloads[0].value
    if encoding is Encoding.CDR_ANY:
        try:
            return PlainPayload(omniORB.cdrUnmarshal(TC_ANY, batch.payloads[0])).value
        except (CORBA.SystemException, SystemError, InvalidEvent):
            pass  # not a CDR encoded `any` after all; for some such data omniORBpy raises SystemError
    return CORBA.Any(RoboCorba._tc_Event, event(batch))


def correlated_events(item: CorrelatedEvents) -> list[Any]:
    """An EventSeq of the correlated events."""
    return [event(batch) for batch in item.batches]


def _header(batch: EventBatch, time: float) -> Any:
    header = batch.header
    encoding = RoboCorba.MSGPACK if header.encoding is Encoding.MSGPACK else RoboCorba.CDR_ANY
    return RoboCorba.EventHeader(
        header.type, header.source, header.origin, batch.first, time, header.priority, header.expiry, encoding
    )


def _payloads(batch: EventBatch) -> Sequence[bytes]:
    if batch.header.encoding is Encoding.NATIVE:
        return [payload.encoded for payload in batch.payloads]
    return batch.payloads


# ---- subscriptions and queues ----


def patterns(values: Iterable[Pattern]) -> list[Any]:
    """An EventPatternSeq."""
    return [RoboCorba.EventPattern(pattern.type, pattern.source) for pattern in values]


def subscription(value: Subscription) -> list[Any]:
    """A Subscription."""
    return [RoboCorba.Clause(patterns(clause.patterns), clause.window) for clause in value]


def subscription_of(struct: Sequence[Any]) -> Subscription:
    """The subscription of an IDL Subscription. Raises InvalidSubscription."""
    return checked([([(p.type, p.source) for p in clause.patterns], clause.window) for clause in struct])


def policy(value: QueuePolicy) -> Any:
    """A QueuePolicy struct."""
    return RoboCorba.QueuePolicy(value.size, _RULES.to_idl(value.when_full), value.block_limit)


def policy_of(struct: Any) -> QueuePolicy:
    """The policy of a QueuePolicy struct. Raises InvalidQueue."""
    return QueuePolicy(struct.size, _RULES.from_idl(struct.whenFull), struct.blockLimit).checked()


# ---- states ----


_ACCOUNT = struct_converter(Account, RoboCorba.Account)
#: A ProxyState struct.
proxy_state = struct_converter(
    *(ProxySnapshot, RoboCorba.ProxyState, {"subscribed": "subscription", "queue": "policy", "events": "totals"}),
    kind=enumeration(ProxyKind),
    condition=enumeration(ProxyCondition),
    subscription=Converter(subscription, subscription_of),
    policy=Converter(policy, policy_of),
    totals=_ACCOUNT,
).to_idl


def link_state(peer: str, direction: Any, end: LinkEnd) -> Any:
    """The LinkState of one direction of a link."""
    return RoboCorba.LinkState(
        peer=peer,
        direction=direction,
        condition=RoboCorba.UP if end.is_up else RoboCorba.DOWN,
        problem=end.problem or end.warning,
        reconnects=max(0, end.joins - 1),
        lag=end.lag_s,
        batches=end.packets,
        bytes=end.bytes,
        repeated=end.totals.repeated,
        unseen=end.unseen,
        interest=patterns(end.interest),
        events=_ACCOUNT.to_idl(end.totals),
    )


def channel_state(channel: Channel, proxies: Proxies, links: Links) -> Any:
    """A ChannelState."""
    with channel.lock:
        known = sorted(advertisement.name for advertisement in channel.federation.advertisements)
    states = []
    for link in links.snapshots():
        states.append(link_state(link.peer, RoboCorba.INCOMING, link.gateway))
        states.append(link_state(link.peer, RoboCorba.OUTGOING, link.feed))
    return RoboCorba.ChannelState(
        channel.name,
        channel.last_number,
        [proxy_state(proxy) for proxy in proxies.snapshots()],
        states,
        proxies.lost_clients,
        known,
    )


def channel_traffic(traffic: ChannelTraffic) -> Any:
    """A ChannelTraffic struct."""
    return RoboCorba.ChannelTraffic(
        traffic.clock_s,
        [RoboCorba.OriginTraffic(name, one.events, one.deliveries) for name, one in traffic.origins.items()],
        traffic.consumers,
        traffic.call_s,
        traffic.fastest_s,
        traffic.service_s,
        traffic.load,
        [RoboCorba.LinkDelay(peer, seconds) for peer, seconds in traffic.round_trips_s.items()],
    )


def traffic_of(struct: Any) -> ChannelTraffic:
    """The traffic of a ChannelTraffic struct."""
    return ChannelTraffic(
        struct.clock,
        {one.origin: OriginTraffic(one.events, one.deliveries) for one in struct.origins},
        struct.consumers,
        struct.call,
        struct.fastestCall,
        struct.service,
        struct.load,
        {one.peer: one.roundTrip for one in struct.delays},
    )


# ---- the federation ----


def feed_terms(feed: Any, session: str, position: int) -> Any:
    """A FeedTerms struct."""
    return RoboCorba.FeedTerms(feed, session, position)


def advertisements(values: Iterable[Advertisement]) -> list[Any]:
    """A LinkNoticeSeq: the IDL calls an advertisement a notice."""
    return [
        RoboCorba.LinkNotice(
            RoboCorba.ChannelNotice(entry.name, entry.version, list(entry.peers), patterns(entry.interest)),
            list(entry.down),
        )
        for entry in values
    ]


def advertisements_of(structs: Iterable[Any]) -> list[Advertisement]:
    """The advertisements of a LinkNoticeSeq, without those with invalid channel names."""
    result = []
    for struct in structs:
        notice, down = struct.notice, tuple(struct.down)
        if is_name(notice.name) and all(map(is_name, (*notice.peers, *down))):
            interest = tuple(Pattern(pattern.type, pattern.source) for pattern in notice.interest)
            result.append(Advertisement(notice.name, notice.version, tuple(notice.peers), interest, down))
    return result


def peer(record: Peer) -> Any:
    """A PeerAddress."""
    return RoboCorba.PeerAddress(record.name, record.address, record.foreign)


def peer_of(struct: Any) -> Peer:
    """The peer of a PeerAddress struct."""
    return Peer(struct.name, struct.address, foreign=bool(struct.foreign))


register_with(errors.EventTooLarge, RoboCorba.InvalidEvent, lambda e: RoboCorba.InvalidEvent(e.field, e.reason))
register(errors.InvalidEvent, RoboCorba.InvalidEvent, "field", "reason")
register(errors.InvalidSubscription, RoboCorba.InvalidSubscription, "where", "reason")
register(errors.InvalidQueue, RoboCorba.InvalidQueue, "field", "reason")
register(errors.TooManyProxies, RoboCorba.TooManyProxies, "limit")
register(errors.UnknownSubscription, RoboCorba.UnknownSubscription, "name")
register(errors.UnknownPeer, RoboCorba.UnknownPeer, "peer", "known")
register(errors.InvalidPeer, RoboCorba.InvalidPeer, "field", "reason")
register_system(errors.ProxyGone, CORBA.OBJECT_NOT_EXIST)
register_with(errors.SessionOver, RoboCorba.SessionOver, lambda e: RoboCorba.SessionOver())
register_with(
    errors.AlreadyConnected, CosEventChannelAdmin.AlreadyConnected, lambda e: CosEventChannelAdmin.AlreadyConnected()
)
register_with(errors.OwnProxy, CosEventChannelAdmin.TypeError, lambda e: CosEventChannelAdmin.TypeError())
register_with(errors.Disconnected, CosEventComm.Disconnected, lambda e: CosEventComm.Disconnected())
