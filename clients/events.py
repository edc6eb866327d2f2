"""Publish and consume events: python -m robocorba.clients.events publish|consume CHANNEL [COUNT]

COUNT is 10 by default. The naming service is at ROBOCORBA_NAMING, by default 127.0.0.1:2809."""

import sys
from queue import SimpleQueue

from robocorba.errors.base import RoboCorbaError
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.orb.orb import Orb
from robocorba.system.printing import fail, line
from robocorba.system.settings import Settings


def publish(events: EventClient, count: int) -> None:
    for number in range(count):
        events.push("robot.state", {"number": number, "x": 0.5 * number, "y": 0.0})


def consume(events: EventClient, count: int) -> None:
    arrived: SimpleQueue[Event] = SimpleQueue()
    events.subscribe(arrived.put, "robot.*")
    line("waiting")
    for _ in range(count):
        event = arrived.get()
        line(f"{event.type} {event.source} {event.payload}")


def main(command: str, channel: str, count: str = "10") -> None:
    with Orb(Settings.read().naming) as orb, EventClient(orb, channel, source="A") as events:
        {"publish": publish, "consume": consume}[command](events, int(count))


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4) or sys.argv[1] not in ("publish", "consume"):
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:])
    except RoboCorbaError as error:
        fail(f"events: {error}")
