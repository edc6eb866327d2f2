"""A consumer in a process of its own: python event_consumer.py CHANNEL_URI FILE [--queue SIZE].

Each event with a string becomes a line of FILE. It is a plain consumer, unless a queue of its own is given.
Prints `ready`; ends with SIGTERM.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import omniORB
from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba, RoboCorba__POA

import CosEventComm__POA  # isort: skip  (found once omniORB is imported)


class PlainConsumer(CosEventComm__POA.PushConsumer):
    """Writes down what comes."""

    def __init__(self, file: Path) -> None:
        self._file = file.open("a", encoding="utf-8", buffering=1)

    def push(self, value: Any) -> None:
        self._file.write(f"{value.value()}\n")

    def disconnect_push_consumer(self) -> None:
        pass


class Consumer(PlainConsumer, RoboCorba__POA.EventConsumer):
    """The same for batches."""

    def pushRuns(self, runs: Any) -> None:
        for run in runs:
            for payload in run.payloads:
                self.push(omniORB.cdrUnmarshal(CORBA.TC_any, payload))

    def pushTogether(self, which: int, events: Any) -> None:
        raise CORBA.NO_IMPLEMENT


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("channel")
    parser.add_argument("file", type=Path)
    parser.add_argument("--queue", type=int, default=0)
    given = parser.parse_args()
    with Orb(Address("127.0.0.1", 1)) as orb:
        channel = orb.reference(given.channel, RoboCorba.EventChannel)
        if given.queue:
            everything = [RoboCorba.Clause([RoboCorba.EventPattern("", "")], 0.0)]
            policy = RoboCorba.QueuePolicy(given.queue, RoboCorba.DISCARD_OLDEST, 0.0)
            channel.subscribe("", orb.activate(Consumer(given.file)), everything, policy)
        else:
            proxy = channel.for_consumers().obtain_push_supplier()
            proxy.connect_push_consumer(orb.activate(PlainConsumer(given.file)))
        print("ready", flush=True)
        orb.run()


if __name__ == "__main__":
    main()
