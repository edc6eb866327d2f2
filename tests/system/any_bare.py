"""A consumer of plain omniORBpy, without anything of ours in between: python any_bare.py

Prints its reference, then a line for each event: its content."""

from __future__ import annotations

import sys
from typing import Any

import omniORB
from omniORB import CORBA

import CosEventComm__POA  # isort: skip  (found once omniORB is imported)

from robocorba.testing.random_anys import content


class Consumer(CosEventComm__POA.PushConsumer):
    def push(self, value: Any) -> None:
        print(content(value), flush=True)

    def disconnect_push_consumer(self) -> None:
        pass


orb = CORBA.ORB_init(["x", "-ORBnativeCharCodeSet", "UTF-8"], CORBA.ORB_ID)
adapter = orb.resolve_initial_references("RootPOA")
adapter._get_the_POAManager().activate()
consumer = Consumer()
print(orb.object_to_string(consumer._this()), flush=True)
assert omniORB.orb is orb
sys.stdin.read()
