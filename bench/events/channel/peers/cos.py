"""Plain clients of any CORBA event channel: one `any` a call, as in the OMG standard."""

from __future__ import annotations

from typing import Any

import CosEventComm__POA
from omniORB import CORBA

from bench.events.channel.peers.base import OneByOne, Receive
from robocorba.corba.orb import Orb
from robocorba.stubs import RoboCorba

OCTETS = RoboCorba._tc_Octets


class PlainSupplier(OneByOne):
    """Pushes to `channel`."""

    def __init__(self, channel: Any) -> None:
        self._proxy = channel.for_suppliers().obtain_push_consumer()
        self._proxy.connect_push_supplier(None)

    def push(self, payload: bytes) -> None:
        self._proxy.push(CORBA.Any(OCTETS, payload))

    def close(self) -> None:
        self._proxy.disconnect_push_consumer()


class PlainConsumer(CosEventComm__POA.PushConsumer):
    """Consumes events of `channel` until `close`."""

    def __init__(self, orb: Orb, channel: Any, receive: Receive) -> None:
        self._receive = receive
        self.proxy = channel.for_consumers().obtain_push_supplier()
        self.proxy.connect_push_consumer(orb.activate(self))

    def push(self, value: Any) -> None:
        self._receive((value.value(),))

    def disconnect_push_consumer(self) -> None:
        pass

    def close(self) -> None:
        self.proxy.disconnect_push_supplier()
