"""The objects of event channels: their proxies, gateways and feeds, by our interfaces and by the standard ones."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import CosEventChannelAdmin
import CosEventComm
import msgpack
from omniORB import CORBA

from robocorba.missions.messages import KINDS
from robocorba.missions.subplan import VERSION
from robocorba.stubs import RoboCorba
from testkit.fuzzing.calls import Target
from testkit.fuzzing.examples import MESSAGE, OTHER, ROBOT, always, example, fresh, with_members
from testkit.fuzzing.fuzzed_system import FuzzedSystem

_PROXIES = ("push_supplier", "pull_supplier", "push_consumer", "pull_consumer")


def end_proxy(system: FuzzedSystem, name: str, result: Any) -> None:
    """Disconnect proxies, and remove peers that were added."""
    if name == "addPeer" or name == "joinPeer":
        for peer in system.channel.peers():
            if peer.name != "b":
                system.channel.removePeer(peer.name)
    if name == "removePeer":
        system.channel.addPeer(RoboCorba.PeerAddress("b", "", False))
    for one in result if isinstance(result, tuple) else (result,):
        for end in _PROXIES:
            if hasattr(one, f"disconnect_{end}"):
                getattr(one, f"disconnect_{end}")()


def targets(system: FuzzedSystem) -> Iterator[Target]:
    """One for each interface."""
    header = RoboCorba.EventHeader("robot.state", ROBOT, "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK)
    payloads: list[Any] = [MESSAGE, {**MESSAGE, "x": "nan"}, {"version": VERSION}, [], {**MESSAGE, "step": -5}]
    events = [
        RoboCorba.Event(_typed(header, type, OTHER), msgpack.packb(payload)) for type in KINDS for payload in payloads
    ]
    events += [RoboCorba.Event(_typed(header, "floor.changed", "L1"), msgpack.packb({"since": 1}))]
    runs = [RoboCorba.EventRun(header, [0.0, 1.0], [b"\xc0", b"\x01"])]
    pattern = RoboCorba.EventPattern("*", "*")
    subscription = [RoboCorba.Clause([pattern], 0.0), RoboCorba.Clause([pattern, pattern], 1.0)]
    queue = RoboCorba.QueuePolicy(100, RoboCorba.DISCARD_OLDEST, 0.0)
    on_proxies = {
        "push": [example(CORBA.Any(RoboCorba._tc_Event, each)) for each in events],
        "pushEvent": [example(each) for each in events],
        "pushRuns": [example(runs)],
        "connect_push_supplier": [example(None)],
        "connect_pull_consumer": [example(None)],
        "connect_push_consumer": [example(system.consumer)],
        "changeSubscription": [example(subscription)],
        "isInForceAt": [example("b")],
    }
    runs_from = [RoboCorba.EventRun(_typed(header, "x", "y", "b"), [1.0], [b"\xc0"])]
    gateway = system.by_key("gateway", RoboCorba.PeerGateway)
    on_channel = {
        "supply": [example("fuzz")],
        "subscribe": [example("", system.consumer, subscription, queue), example("kept", system.consumer, [], queue)],
        "unsubscribe": [example("kept")],
        "addPeer": [example(RoboCorba.PeerAddress("c", "127.0.0.1:9", False))],
        "removePeer": [example("b")],
        "joinGateway": [example("c", system.channel, gateway)],
        "joinPeer": [example("c", system.channel, gateway)],
        **on_proxies,
    }
    destroyed, end = frozenset({"destroy"}), partial(end_proxy, system)
    for interface in (RoboCorba.EventChannel, CosEventChannelAdmin.EventChannel):
        reference = system.channel._unchecked_narrow(interface)
        yield Target(interface, always(reference), on_channel, end, omitted=destroyed)
    for key, interface in (
        ("consumers", CosEventChannelAdmin.ConsumerAdmin),
        ("suppliers", CosEventChannelAdmin.SupplierAdmin),
    ):
        yield Target(interface, always(system.by_key(key, interface)), {}, end)
    disconnections = frozenset(f"disconnect_{kind}" for kind in _PROXIES)
    blocked = frozenset({"pull"})
    for kind, proxy, base, own in (
        ("push_consumer", RoboCorba.EventProxyPushConsumer, CosEventChannelAdmin.ProxyPushConsumer, "PushConsumer"),
        ("push_supplier", RoboCorba.EventProxyPushSupplier, CosEventChannelAdmin.ProxyPushSupplier, "PushSupplier"),
        ("pull_supplier", RoboCorba.EventProxyPullSupplier, CosEventChannelAdmin.ProxyPullSupplier, "PullSupplier"),
        ("pull_consumer", None, CosEventChannelAdmin.ProxyPullConsumer, "PullConsumer"),
    ):
        for interface in filter(None, (proxy, base, getattr(CosEventComm, own))):
            make = fresh(partial(system.proxy, kind, interface), f"disconnect_{kind}")
            also = {"": (CosEventComm.Disconnected,)}
            yield Target(interface, make, on_proxies, ends=disconnections, also=also, omitted=blocked)
    notice = RoboCorba.ChannelNotice("c", 1, ["a"], [pattern])
    ways = [RoboCorba.EventWay([RoboCorba.EventTarget("c", 1)], 1)]
    join = {
        "forward": [example("session", 1, runs_from)],
        "forwardOn": [example("session", 1, [0.0], ways, runs_from)],
        "acknowledge": [example("session", 1)],
        "renew": [example("session", 1, [notice])],
        "renewPeer": [example("session", 1, 0, [RoboCorba.LinkNotice(notice, ["a"])])],
        "leave": [example("session")],
    }
    for key, interface in (
        ("gateway", RoboCorba.PeerGateway),
        ("gateway", RoboCorba.EventGateway),
        ("feed", RoboCorba.PeerFeed),
        ("feed", RoboCorba.GatewayFeed),
    ):
        yield Target(interface, always(system.by_key(key, interface)), join)


def _typed(header: Any, type: str, source: str, origin: str = "") -> Any:
    return with_members(header, type=type, source=source, origin=origin, number=1 if origin else 0)
