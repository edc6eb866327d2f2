"""Events of any type through all kinds of clients and channels, value for value: of IDL types drawn at random, of types
that only a client has stubs of, and of those that omniORBpy can't read, which are refused.

ANY_DRAWS=2000 pytest tests/system/test_event_any_types.py draws more types, ANY_SEED=1 others."""

from __future__ import annotations

import os
import queue
import subprocess
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import CosEventComm
import omniORB
import pytest
from omniORB import CORBA
from omniORB import tcInternal as tc

from robocorba.corba.conversion.bounded_any import TC_ANY, invoke
from robocorba.corba.event_client import EventClient
from robocorba.supervision.launch import ChildProcess
from robocorba.testing.fuzzing.wire import OCTETS, in_turn
from robocorba.testing.random_anys import RandomAnys, content
from tests.system.event_place import QUEUE, EventConsumer, Place, PushConsumer, clauses, open_place
from tests.system.test_cpp_clients import CLEAN, OMNIIDL, has_cpp

pytestmark = [pytest.mark.system, pytest.mark.full]

DRAWS, SEED = int(os.environ.get("ANY_DRAWS", "60")), int(os.environ.get("ANY_SEED", "0"))
LIMIT_S = 60.0
HERE = Path(__file__).parent
IDL = HERE.parents[1] / "idl"
#: omniORBpy omits the repository id before the members of an exception, so that programs in C++ can't read it.
NO_EXCEPTIONS = [tc.tv_except]
#: The type of a valuetype without members.
VALUE = tc.createTypeCode(
    (tc.tv_value, omniORB.UnknownValueBase, "IDL:Foreign/Val:1.0", "Val", CORBA.VM_NONE, None, tc.tv_null)
)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with open_place(tmp_path_factory.mktemp("any types")) as place:
        place.start("lab")
        place.start("hall", "robocorba.servers.event_channel", "--peer", f"lab={place.uri('lab')}")
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
        for way, channel in (("pushed", lab), ("pushed after a gateway", hall)):
            got = self._queue(way)
            place.push_to(PushConsumer(take=lambda value, got=got: got.put(content(value))), channel)
        headers = HeaderConsumer(self._queue("with header after a gateway"))
        hall.subscribe("", place.orb.activate(headers), clauses("*"), QUEUE)
        values = self._queue("value in EventClient")
        subscription = client.subscribe(lambda event: values.put(content(event.payload)))
        self._pull = lab.for_consumers().obtain_pull_supplier()
        self._pull.connect_pull_consumer(None)
        assert subscription.wait_in_force("lab")

    def _queue(self, way: str) -> queue.Queue[Any]:
        self.got[way] = queue.Queue()
        return self.got[way]

    def next(self) -> dict[str, Any]:
        """What comes next, by the way of an event."""
        came = {way: got.get(timeout=LIMIT_S) for way, got in self.got.items()}
        return {**came, "pulled": content(invoke(self._pull, CosEventComm.PullSupplier, "pull"))}


class HeaderConsumer(EventConsumer):
    def __init__(self, got: queue.Queue[Any]) -> None:
        super().__init__()
        self._queue = got

    def pushRuns(self, runs: Any) -> None:
        for run in runs:
            for payload in run.payloads:
                self._queue.put(content(omniORB.cdrUnmarshal(TC_ANY, payload)))


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


def test_a_value_of_any_type_is_what_a_bare_servant_reads(place: Place, reference: Any) -> None:
    """Without wide characters, which omniORBpy does not read."""
    bare = place.client("any_consumer", "bare")
    assert bare.stdout
    consumer = place.orb.reference(bare.stdout.readline().strip(), CosEventComm.PushConsumer)
    source = place.channel("lab").for_consumers().obtain_push_supplier()
    source.connect_push_consumer(consumer)
    supplier = place.supplier()
    drawn = RandomAnys(Random(SEED + 1), [reference], without=[tc.tv_wchar])
    for number in range(DRAWS):
        value = drawn.any()
        consumer.push(value)
        directly = bare.stdout.readline()
        assert directly == f"{content(value)}\n"
        supplier.push(value)
        assert bare.stdout.readline() == directly, number
    source.disconnect_push_supplier()
    supplier.disconnect_push_consumer()


@pytest.fixture(scope="module")
def cpp_peer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program any_peer.cc."""
    if not has_cpp():
        pytest.skip("needs g++, libomniorb4-dev and omniidl with its back-end for C++")
    folder = tmp_path_factory.mktemp("any_peer")
    modules = ("CosEventComm", "CosEventChannelAdmin")
    for module in modules:
        run(OMNIIDL, "-bcxx", f"-I{IDL}", "-C", str(folder), str(IDL / f"{module}.idl"))
    program = folder / "any_peer"
    stubs = [str(folder / f"{module}SK.cc") for module in modules]
    libraries = ("-lomniDynamic4", "-lomniORB4", "-lomnithread")
    run("g++", "-std=c++17", f"-I{folder}", "-o", str(program), str(HERE / "any_peer.cc"), *stubs, *libraries)
    return program


def run(*command: str | None) -> None:
    ran = subprocess.run([str(each) for each in command], capture_output=True, text=True, env=CLEAN, timeout=250)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize("consumed", ["lab", "hall"])
def test_a_client_in_cpp_gets_what_it_has_pushed(place: Place, cpp_peer: Path, reference: Any, consumed: str) -> None:
    peer = place.launch(str(cpp_peer), place.uri("lab"), place.uri(consumed))
    assert peer.stdin and peer.stdout
    assert peer.stdout.readline() == "ready\n"
    drawn, impossible = RandomAnys(Random(SEED + 2), [reference], NO_EXCEPTIONS), 0
    for number in range(DRAWS):
        peer.stdin.write(f"{omniORB.cdrMarshal(CORBA.TC_any, drawn.any()).hex()}\n")
        peer.stdin.flush()
        came = peer.stdout.readline().strip()
        if came == "impossible":
            impossible += 1
            continue
        before, _, after = came.partition(" ")
        assert len(after) > 8, (number, came)
        assert decoded(after) == decoded(before), number
    assert impossible <= DRAWS // 20


def decoded(encoded: str) -> Any:
    return content(omniORB.cdrUnmarshal(TC_ANY, bytes.fromhex(encoded)))


# ---- types that only the client has stubs of ----


def test_values_come_unchanged_to_a_client_that_knows_their_types(place: Place) -> None:
    """Values of valuetypes, too, where a channel accepts them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROBOCORBA_VALUETYPES", "1")
        place.start("values")
        client = place.client("event_types_client", place.uri("values"))
    out, err = client.communicate(timeout=120)
    assert client.returncode == 0, err
    found = {(type, way): rest[0] for type, way, *rest in (line.split(": ", 2) for line in out.splitlines())}
    assert found.pop(("boxed value", "refused")).startswith("CORBA.MARSHAL")  # it needs stubs
    for way in ("pushed", "with header", "pulled"):  # what is more than its type says is cut, as its IDL allows
        assert found.pop(("derived value as its base", way)).endswith("('Tag', [('name', 'a'), ('number', 1)]))")
    assert len(found) == 3 * 9
    assert {what for what, how in found.items() if how != "same"} == set()
    assert place.balanced_states("values")


# ---- events that nobody can read ----


def ulongs(*numbers: int) -> Any:
    """Numbers one after the other, in one array."""
    return (tc.tv_array, tc.tv_ulong, len(numbers)), list(numbers)


def nested_types(count: int) -> Any:
    """The beginning of sequences of sequences, each an encapsulation in big-endian order."""
    sizes = [8 + 16 * number for number in range(count, 0, -1)]
    return ulongs(*(number for size in sizes for number in (tc.tv_sequence, size, 0)), *[0] * (count + 2))


@pytest.fixture(scope="module")
def reader(place: Place) -> ChildProcess:
    """A process that gets such events, and goes on."""
    return place.client("any_consumer")


@pytest.fixture(scope="module")
def consumer(place: Place, reader: ChildProcess) -> Any:
    assert reader.stdout
    return place.orb.reference(reader.stdout.readline().strip(), CosEventComm.PushConsumer)


@pytest.mark.parametrize(
    ("descriptor", "value"),
    [
        in_turn(ulongs(*[tc.tv_any] * 1_000_000, tc.tv_null)),
        in_turn(nested_types(10_000)),
        in_turn((tc.tv_ulong, tc.tv_struct), (OCTETS, bytes(40))),
        in_turn((tc.tv_ulong, tc.tv_objref), (OCTETS, b"\1" + bytes(43))),
        in_turn((tc.tv_ulong, tc.tv_fixed), (tc.tv_ushort, 0), (tc.tv_short, 0), (OCTETS, bytes(40))),
        in_turn((tc.tv_TypeCode, CORBA.TC_Object), (OCTETS, b"\xff\xfe\0"), (tc.tv_ulong, 0)),
        in_turn((tc.tv_TypeCode, VALUE), ulongs(0x7FFFFF06, 0)),
    ],
    ids=["anys", "types", "empty text", "empty texts", "fixed", "reference", "value"],
)
def test_an_event_that_nobody_can_read_is_refused(
    reader: ChildProcess, consumer: Any, descriptor: Any, value: Any
) -> None:
    _, returned, raised = CosEventComm.PushConsumer._d_push
    with pytest.raises(CORBA.MARSHAL):
        consumer._obj.invoke("push", ((descriptor,), returned, raised), (value,))
    consumer.push(CORBA.Any(CORBA.TC_any, CORBA.Any(CORBA.TC_string, "ナビ")))
    assert reader.stdout and "ナビ" in reader.stdout.readline()
    assert reader.poll() is None
