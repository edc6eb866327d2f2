"""Publish and consume events with OMG's interfaces only, as any CORBA client of an event channel can:

python -m robocorba.clients.plain_events publish|consume CHANNEL [COUNT [NAMING_HOST:PORT]] [-ORB...]

COUNT is 10 and the naming service 127.0.0.1:2809 by default."""

import sys
import threading
import time
from queue import SimpleQueue
from typing import Any

from omniORB import CORBA  # first: it makes OMG's stubs importable

# isort: split
import CosEventChannelAdmin
import CosEventComm__POA


class PrintingConsumer(CosEventComm__POA.PushConsumer):
    def __init__(self) -> None:
        self.arrived: SimpleQueue[Any] = SimpleQueue()

    def push(self, value: Any) -> None:
        self.arrived.put(value.value())

    def disconnect_push_consumer(self) -> None:
        pass  # called when the channel is destroyed, and also when this consumer disconnects


def publish(channel: Any, count: int) -> None:
    proxy = channel.for_suppliers().obtain_push_consumer()
    proxy.connect_push_supplier(None)  # nil: no notification when the channel is destroyed
    for number in range(count):
        proxy.push(CORBA.Any(CORBA.TC_string, f"reading {number}"))
    proxy.disconnect_push_consumer()


def consume(channel: Any, count: int, orb: Any) -> None:
    poa = orb.resolve_initial_references("RootPOA")
    poa._get_the_POAManager().activate()
    consumer = PrintingConsumer()
    proxy = channel.for_consumers().obtain_push_supplier()
    proxy.connect_push_consumer(consumer._this())
    print("waiting", flush=True)
    for _ in range(count):
        print(consumer.arrived.get())
    proxy.disconnect_push_supplier()


def main(arguments: list[str]) -> None:
    orb = CORBA.ORB_init(arguments, CORBA.ORB_ID)  # removes the -ORB arguments
    command, channel_name, *options = arguments[1:]
    count, naming = [*options, *["10", "127.0.0.1:2809"][len(options) :]]
    found = orb.string_to_object(f"corbaname::{naming}#RoboCorba/EventChannels/{channel_name}")
    channel = found._narrow(CosEventChannelAdmin.EventChannel)
    if command == "publish":
        publish(channel, int(count))
    else:
        consume(channel, int(count), orb)
    orb.destroy()
    for _ in range(100):  # at most 5 s, until omniORB's threads that called the consumer have ended
        if threading.active_count() == 1:
            break
        time.sleep(0.05)


if __name__ == "__main__":
    if len(sys.argv) < 3 or sys.argv[1] not in ("publish", "consume"):
        sys.exit(__doc__)
    main(sys.argv)
