"""A consumer that prints its reference, then a line for each event: python any_consumer.py"""

from __future__ import annotations

import sys
from typing import Any

from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba__POA


class Consumer(RoboCorba__POA.EventConsumer):
    def push(self, data: Any) -> None:
        print(repr(data.value()), flush=True)

    def disconnect_push_consumer(self) -> None:
        pass


with Orb(Address("127.0.0.1", 1)) as orb:
    print(orb.uri(orb.activate(Consumer())), flush=True)
    sys.stdin.read()
