"""Events of IDL types drawn at random through all kinds of clients and channels, value for value.

ANY_DRAWS=2000 pytest tests/system/test_event_any_types.py draws more types, ANY_SEED=1 others."""

from __future__ import annotations

import os
import queue
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import CosEventComm
import omniORB
import pytest
from omniORB import CORBA

from robocorba.events.corba.event_client import EventClient
from robocorba.orb.bounded_any import TC_ANY, invoke
from testkit.random_anys import RandomAnys, content
from tests.system.event_place import QUEUE, EventConsumer, Place, PushConsumer, clauses, open_place

pytestmark = [pytest.mark.system, pytest.mark.full]

DRAWS, SEED = int(os.environ.get("ANY_DRAWS", "60")), int(os.environ.get("ANY_SEED", "0"))
LIMIT_S = 60.0


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with open_place(tmp_path_factory.mktemp("any types")) as place:
        place.begin("lab")
        place.begin("hall", "--peer", f"lab={place.uri('lab')}")
        yield place


@pytest.fixture(scope="module")
def reference(place: Place) -> Any:
    """A reference to an object of an interface that nobody has stubs of."""
    ior = place.orb.uri(place.orb.reference("corbaloc:iiop:127.0.0.1:1/robot", CORBA.Object))
    id = b"IDL:Random/Robot:1.0\0"
    size = int.from_bytes(bytes.fromhex(ior[12:20]), "little")
    profiles = ior[20 + 2 * (size + -size % 4) :]
    return place.orb.reference(
        f"{ior[:12]}{len(id).to_bytes(4, 'little').hex()}{(id + bytes(-len(id) % 4)).hex()}{profiles}", CORBA.Object
    )


class Receiver:
    """Clients of all kinds, and what comes to each: the content of an `any`, or only that of its value."""

    def __init__(self, place: Place, client: EventClient) -> None:
        self.got: dict[str, queue.Queue[Any]] = {}
        lab, hall = place.channel("lab"), place.channel("hall")
        place.push_to(PushConsumer(take=self._put("pushed")), lab)
        place.push_to(PushConsumer(take=self._put("pushed after a gateway")), hall)
        headers = place.orb.activate(HeaderConsumer(self._put("with header after a gateway")))
        hall.subscribe("", headers, clauses("*"), QUEUE)
        put_value = self._put("value in EventClient")
        subscription = client.subscribe(lambda event: put_value(event.payload))
        self._pull = lab.for_consumers().obtain_pull_supplier()
        self._pull.connect_pull_consumer(None)
        assert subscription.wait_in_force("lab")

    def _put(self, way: str) -> Callable[[Any], None]:
        got = self.got[way] = queue.Queue()
        return lambda value: got.put(content(value))

    def next(self) -> dict[str, Any]:
        """What comes next, by the way of an event."""
        came = {way: got.get(timeout=LIMIT_S) for way, got in self.got.items()}
        return {**came, "pulled": content(invoke(self._pull, CosEventComm.PullSupplier, "pull"))}


class HeaderConsumer(EventConsumer):
    """Puts each event into a queue, decoded."""

    def __init__(self, put: Callable[[Any], None]) -> None:
        super().__init__()
        self._put = put

    def pushRuns(self, runs: Any) -> None:
        for run in runs:
            for payload in run.payloads:
                self._put(omniORB.cdrUnmarshal(TC_ANY, payload))


def test_a_value_of_any_type_comes_unchanged_to_every_client(place: Place, reference: Any) -> None:
    drawn = RandomAnys(Random(SEED), [reference])
    supplier = place.supplier()
    with EventClient(place.orb, "hall", channel_at=place.channel("hall")) as client:
        receiver = Receiver(place, client)
        for number in range(DRAWS):
            value = drawn.any()
            supplier.push(value)
            expected = content(value)
            for way, came in receiver.next().items():
                assert came == (expected[2] if way == "value in EventClient" else expected), (number, way)
    supplier.disconnect_push_consumer()
