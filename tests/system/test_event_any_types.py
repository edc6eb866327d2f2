"""Events of any type through all kinds of clients and channels, value for value: of IDL types drawn at random, of types
that only a client has stubs of.

ANY_DRAWS=2000 pytest tests/system/test_event_any_types.py draws more types, ANY_SEED=1 others."""

from __future__ import annotations

import importlib
import os
import queue
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import CosEventComm
import omniORB
import pytest
from omniORB import CORBA
from omniORB import tcInternal as tc

from robocorba.events.corba.event_client import EventClient
from robocorba.orb.bounded_any import TC_ANY, invoke
from testkit.random_anys import RandomAnys, content
from tests.system.event_place import QUEUE, EventConsumer, Place, PushConsumer, clauses, open_place
from tests.system.test_cpp_clients import OMNIIDL, has_cpp, run_clean

pytestmark = [pytest.mark.system, pytest.mark.full]

DRAWS, SEED = int(os.environ.get("ANY_DRAWS", "60")), int(os.environ.get("ANY_SEED", "0"))
LIMIT_S = 60.0
HERE = Path(__file__).parent
IDL = HERE.parents[1] / "idl"
#: omniORBpy omits the repository id before the members of an exception, so that programs in C++ can't read it.
NO_EXCEPTIONS = [tc.tv_except]


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


@pytest.fixture(scope="module")
def cpp_peer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program any_peer.cc."""
    if not has_cpp():
        pytest.skip("needs g++, libomniorb4-dev and omniidl with its back-end for C++")
    folder = tmp_path_factory.mktemp("any_peer")
    modules = ("CosEventComm", "CosEventChannelAdmin")
    for module in modules:
        made(OMNIIDL, "-bcxx", f"-I{IDL}", "-C", str(folder), str(IDL / f"{module}.idl"))
    program = folder / "any_peer"
    stubs = [str(folder / f"{module}SK.cc") for module in modules]
    libraries = ("-lomniDynamic4", "-lomniORB4", "-lomnithread")
    made("g++", "-std=c++17", f"-I{folder}", "-o", str(program), str(HERE / "any_peer.cc"), *stubs, *libraries)
    return program


def made(*command: str | None) -> None:
    ran = run_clean(*command)
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


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The stubs of event_types.idl."""
    folder = tmp_path_factory.mktemp("stubs")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(IDL)
        importlib.import_module("make_stubs").omniidl("-bpython", "-C", str(folder), str(HERE / "event_types.idl"))
        patch.syspath_prepend(folder)
        return importlib.import_module("Foreign")


def told(value: Any, depth: int = 0) -> Any:
    """The content of a value, to be compared; valuetypes may be rings."""
    if isinstance(value, CORBA.ValueBase) and depth < 6:
        return type(value).__name__, [(name, told(each, depth + 1)) for name, each in sorted(vars(value).items())]
    return type(value).__name__, str(value) if depth < 6 else ""


def test_values_come_unchanged_to_a_client_that_knows_their_types(
    place: Place, foreign: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Values of valuetypes, too, where a channel accepts them. A derived one is cut as its IDL allows."""
    monkeypatch.setenv("ROBOCORBA_VALUETYPES", "1")
    channel, pushed, with_header = place.begin("values"), queue.Queue[Any](), queue.Queue[Any]()
    place.push_to(PushConsumer(take=pushed.put), channel)
    channel.subscribe("", place.orb.activate(HeaderConsumer(with_header.put)), clauses(""), QUEUE)
    puller = channel.for_consumers().obtain_pull_supplier()
    puller.connect_pull_consumer(None)
    everything = foreign.Everything(
        True, "z", 255, -32768, 2**32 - 1, -(2**63), 2**64 - 1, 0.5, 0.1, "žluť", "řeč 机器人", foreign.CROSS,
        [foreign.Point(1.0, 2.0), foreign.Point(3.0, 4.0)], [[1, 2, 3], [4, 5, 6]],
        CORBA.Any(foreign._tc_Point, foreign.Point(5.0, 6.0)),
    )  # fmt: skip
    tree = foreign.Tree("root", [foreign.Tree("leaf", []), foreign.Tree("twig", [foreign.Tree("bud", [])])])
    ring = foreign.Link("a", foreign.Link("b", None))
    ring.next.next = ring
    supplier = place.supplier(channel)
    for typecode, value, *cut in (
        (foreign._tc_Everything, everything),
        (foreign._tc_Choice, foreign.Choice(where=foreign.Point(1.0, 2.0))),
        (foreign._tc_Tree, tree),
        (foreign._tc_Broken, foreign.Broken("wheel")),
        (foreign._tc_Tag, foreign.Tag("a", 1)),
        (foreign._tc_Tag, None),
        (foreign._tc_Label, foreign.Label("a", 1, foreign.Tag("b", 2))),
        (foreign._tc_Tag, foreign.Label("a", 1, None), foreign.Tag("a", 1)),
        (foreign._tc_Link, ring),
    ):
        supplier.push(CORBA.Any(typecode, value))
        for came in (pushed.get(timeout=LIMIT_S), with_header.get(timeout=LIMIT_S), puller.pull()):
            assert came.typecode().equal(typecode)
            assert told(came.value()) == told(*cut or (value,))
    with pytest.raises(CORBA.MARSHAL):  # it needs stubs
        supplier.push(CORBA.Any(foreign._tc_Boxed, foreign.Point(1.0, 2.0)))
    assert place.balanced_states("values")
