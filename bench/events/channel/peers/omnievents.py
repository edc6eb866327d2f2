"""omniEvents with a channel period of 1 us; its default of 100 ms would not be comparable."""

from __future__ import annotations

import contextlib
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import CosEventChannelAdmin
from omniORB import CORBA

from bench.events.channel.peers.base import Broker, Receive, Start, free_port, lacking, program
from bench.events.channel.peers.cos import PlainConsumer, PlainSupplier
from bench.events.channel.peers.ours import naming_service
from robocorba.corba.orb import Orb
from robocorba.settings import Address

_START_LIMIT_S = 15.0
CYCLE_NS = 1000


class OmniEvents:
    name, batches = "omniEvents, tuned", False

    def missing(self) -> str:
        return lacking(programs=["omniEvents", "eventc"])

    @contextlib.contextmanager
    def broker(self, folder: Path, start: Start) -> Iterator[Broker]:
        port, state = free_port(), folder / "omniEvents"
        state.mkdir()
        naming = ("-ORBInitRef", f"NameService=corbaloc::{naming_service(folder, start)}/NameService")
        where = ("-p", str(port), "-l", str(state), "-t", str(state / "trace"))
        pid = start(program("omniEvents"), "-f", *where, *naming)
        factory = f"corbaloc::127.0.0.1:{port}/omniEvents"
        make = (program("eventc"), "-n", "bench", "-i", "bench", "-c", str(CYCLE_NS), *naming, factory)
        deadline = time.monotonic() + _START_LIMIT_S
        while subprocess.run(make, capture_output=True, timeout=10).returncode:
            if time.monotonic() > deadline:
                raise TimeoutError("omniEvents did not make a channel")
            time.sleep(0.1)
        yield Broker(f"corbaloc::127.0.0.1:{port}/bench", pid)

    @contextlib.contextmanager
    def supplier(self, address: str) -> Iterator[PlainSupplier]:
        with _orb() as orb:
            supplier = PlainSupplier(orb.reference(address, CosEventChannelAdmin.EventChannel))
            yield supplier
            with contextlib.suppress(CORBA.Exception):
                supplier.close()

    @contextlib.contextmanager
    def consumer(self, address: str, receive: Receive) -> Iterator[None]:
        with _orb() as orb:
            consumer = PlainConsumer(orb, orb.reference(address, CosEventChannelAdmin.EventChannel), receive)
            yield
            with contextlib.suppress(CORBA.Exception):
                consumer.close()


def _orb() -> Orb:
    return Orb(Address("127.0.0.1", 1))  # an unused port: the channel is called by corbaloc, without a naming service


PEER = OmniEvents()
