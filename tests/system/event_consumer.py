"""A consumer in a process of its own: python -m tests.system.event_consumer CHANNEL_URI FILE [--queue SIZE].

Each event with a string becomes a line of FILE. It is a plain consumer, unless a queue of its own is given.
Prints `ready`; ends with SIGTERM."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import omniORB
from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from tests.system.event_place import EventConsumer, PushConsumer, clauses


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("channel")
    parser.add_argument("file", type=Path)
    parser.add_argument("--queue", type=int, default=0)
    given = parser.parse_args()
    with given.file.open("a", encoding="utf-8", buffering=1) as file, Orb(Address("127.0.0.1", 1)) as orb:

        def take(value: Any) -> None:
            file.write(f"{value.value()}\n")

        class Consumer(EventConsumer):
            def pushRuns(self, runs: Any) -> None:
                for run in runs:
                    for payload in run.payloads:
                        take(omniORB.cdrUnmarshal(CORBA.TC_any, payload))

        channel = orb.reference(given.channel, RoboCorba.EventChannel)
        if given.queue:
            policy = RoboCorba.QueuePolicy(given.queue, RoboCorba.DISCARD_OLDEST, 0.0)
            channel.subscribe("", orb.activate(Consumer()), clauses(""), policy)
        else:
            proxy = channel.for_consumers().obtain_push_supplier()
            proxy.connect_push_consumer(orb.activate(PushConsumer(take=take)))
        print("ready", flush=True)
        orb.run()


if __name__ == "__main__":
    main()
