"""A consumer that prints its reference, then a line for each event, its content: python any_consumer.py [batches]

batches: it takes events with headers, in batches."""

from __future__ import annotations

import sys
from typing import Any

import omniORB
from omniORB import CORBA

import CosEventComm__POA  # isort: skip  (found once omniORB is imported)

from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba__POA
from robocorba.system.settings import Address
from testkit.random_anys import content


class Consumer(CosEventComm__POA.PushConsumer):
    def push(self, value: Any) -> None:
        print(content(value), flush=True)

    def disconnect_push_consumer(self) -> None:
        pass


class Batches(Consumer, RoboCorba__POA.EventConsumer):
    def pushRuns(self, runs: Any) -> None:
        for run in runs:
            for payload in run.payloads:
                self.push(omniORB.cdrUnmarshal(CORBA.TC_any, payload))


with Orb(Address("127.0.0.1", 1)) as orb:
    consumer = Batches() if sys.argv[1:] == ["batches"] else Consumer()
    print(orb.uri(orb.activate(consumer)), flush=True)
    sys.stdin.read()
