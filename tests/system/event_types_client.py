"""A client that knows types of its own: python -m tests.system.event_types_client CHANNEL_URI.

Makes the stubs of event_types.idl for itself, pushes a value of each type through the channel, gets it back in three
ways, and prints one line for each: the type, the way, and `same` or what came."""

from __future__ import annotations

import queue
import sys
import tempfile
from pathlib import Path
from typing import Any

import omniORB
from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from tests.system.event_place import QUEUE, EventConsumer, PushConsumer, clauses

IDL = Path(__file__).with_name("event_types.idl")
ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 10.0


def make_stubs(folder: str) -> Any:
    """The module Foreign."""
    sys.path.insert(0, str(ROOT / "idl"))
    from make_stubs import omniidl

    omniidl("-bpython", "-C", folder, str(IDL))
    sys.path.insert(0, folder)
    import Foreign

    return Foreign


class WithHeader(EventConsumer):
    """Puts what it gets into a queue, decoded."""

    def __init__(self) -> None:
        super().__init__()
        self.queue: queue.Queue[Any] = queue.Queue()

    def pushRuns(self, runs: Any) -> None:
        for run in runs:
            for payload in run.payloads:
                self.queue.put(omniORB.cdrUnmarshal(CORBA.TC_any, payload))


def samples(foreign: Any, robot: Any) -> dict[str, tuple[Any, Any]]:
    """A typecode and a value for each name."""
    everything = foreign.Everything(
        True, "z", 255, -32768, 2**32 - 1, -(2**63), 2**64 - 1, 0.5, 0.1, "žluť", "řeč 机器人", foreign.CROSS,
        [foreign.Point(1.0, 2.0), foreign.Point(3.0, 4.0)], [[1, 2, 3], [4, 5, 6]],
        CORBA.Any(foreign._tc_Point, foreign.Point(5.0, 6.0)),
    )  # fmt: skip
    tree = foreign.Tree("root", [foreign.Tree("leaf", []), foreign.Tree("twig", [foreign.Tree("bud", [])])])
    ring = foreign.Link("a", foreign.Link("b", None))
    ring.next.next = ring
    return {
        "struct": (foreign._tc_Everything, everything),
        "union": (foreign._tc_Choice, foreign.Choice(where=foreign.Point(1.0, 2.0))),
        "recursive": (foreign._tc_Tree, tree),
        "exception": (foreign._tc_Broken, foreign.Broken("wheel")),
        "object reference": (foreign._tc_Robot, robot),
        "valuetype": (foreign._tc_Tag, foreign.Tag("a", 1)),
        "no value": (foreign._tc_Tag, None),
        "derived value": (foreign._tc_Label, foreign.Label("a", 1, foreign.Tag("b", 2))),
        "derived value as its base": (foreign._tc_Tag, foreign.Label("a", 1, None)),
        "boxed value": (foreign._tc_Boxed, foreign.Point(1.0, 2.0)),
        "value ring": (foreign._tc_Link, ring),
    }


def told(value: Any, depth: int = 0) -> Any:
    """The content of any value, to be compared."""
    if depth > 6:
        return "..."
    if isinstance(value, CORBA.Object):
        return value.greet()
    if isinstance(value, list | tuple):
        return [told(one, depth + 1) for one in value]
    if isinstance(value, CORBA.Any):
        return ("any", value.typecode().kind(), told(value.value(), depth + 1))
    if isinstance(value, omniORB.Union):
        return (told(value._d), told(value._v, depth + 1))
    if isinstance(value, omniORB.EnumItem):
        return (value._n, value._v)
    if hasattr(value, "__dict__"):
        return (type(value).__name__, [(key, told(one, depth + 1)) for key, one in sorted(vars(value).items())])
    return value


def main() -> None:
    with tempfile.TemporaryDirectory() as folder, Orb(Address("127.0.0.1", 1), call_timeout_s=LIMIT_S) as orb:
        foreign = make_stubs(folder)
        import Foreign__POA

        class Robot(Foreign__POA.Robot):
            def greet(self) -> str:
                return "I am a robot"

        channel = orb.reference(sys.argv[1], RoboCorba.EventChannel)
        pushed, with_header = queue.Queue[Any](), WithHeader()
        plain = PushConsumer(take=pushed.put)
        channel.for_consumers().obtain_push_supplier().connect_push_consumer(orb.activate(plain))
        channel.subscribe("", orb.activate(with_header), clauses(""), QUEUE)
        puller = channel.for_consumers().obtain_pull_supplier()
        puller.connect_pull_consumer(None)
        supplier = channel.for_suppliers().obtain_push_consumer()
        supplier.connect_push_supplier(None)
        ways = {
            "pushed": lambda: pushed.get(timeout=LIMIT_S),
            "with header": lambda: with_header.queue.get(timeout=LIMIT_S),
            "pulled": puller.pull,
        }
        for name, (typecode, value) in samples(foreign, orb.activate(Robot())).items():
            try:
                supplier.push(CORBA.Any(typecode, value))
            except CORBA.SystemException as error:
                print(f"{name}: refused: {error}", flush=True)
                continue
            for way, receive in ways.items():
                try:
                    came = receive()
                    is_same = came.typecode().equal(typecode) and told(came.value()) == told(value)
                    print(f"{name}: {way}: {'same' if is_same else told(came)}", flush=True)
                except (CORBA.SystemException, queue.Empty) as error:
                    print(f"{name}: {way}: {error!r}", flush=True)


if __name__ == "__main__":
    main()
