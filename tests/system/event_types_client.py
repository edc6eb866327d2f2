"""A client that knows types of its own: python event_types_client.py CHANNEL_URI.

Makes the stubs of event_types.idl for itself, pushes a value of each type through the channel, gets it back in three
ways, and prints one line for each: the type, the way, and `same` or what came.
"""

from __future__ import annotations

import queue
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import omniORB
from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba, RoboCorba__POA

import CosEventComm__POA  # isort: skip  (found once omniORB is imported)

IDL = Path(__file__).with_name("event_types.idl")
ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 10.0


def make_stubs(folder: str) -> Any:
    """The module Foreign."""
    sys.path.insert(0, str(ROOT / "idl"))
    from make_stubs import omniidl

    omniidl("-bpython", "-C", folder, str(IDL))
    sys.path.insert(0, folder)
    import Foreign  # type: ignore[import-not-found]

    return Foreign


class Plain(CosEventComm__POA.PushConsumer):
    """Puts what it gets into a queue."""

    def __init__(self) -> None:
        self.got: queue.Queue[Any] = queue.Queue()

    def push(self, value: Any) -> None:
        self.got.put(value)

    def disconnect_push_consumer(self) -> None:
        pass


class WithHeader(RoboCorba__POA.EventConsumer):
    """The same of what a consumer with headers gets, decoded."""

    def __init__(self) -> None:
        self.got: queue.Queue[Any] = queue.Queue()

    def pushRuns(self, runs: Any) -> None:
        for run in runs:
            for payload in run.payloads:
                self.got.put(omniORB.cdrUnmarshal(CORBA.TC_any, payload))

    def pushTogether(self, which: int, events: Any) -> None:
        pass

    def push(self, value: Any) -> None:
        pass

    def disconnect_push_consumer(self) -> None:
        pass


def samples(foreign: Any, robot: Any) -> dict[str, tuple[Any, Any]]:
    """A typecode and a value for each name."""
    inner = CORBA.Any(foreign._tc_Point, foreign.Point(5.0, 6.0))
    everything = foreign.Everything(
        True, "z", 255, -32768, 2**32 - 1, -(2**63), 2**64 - 1, 0.5, 0.1, "žluť", "řeč 机器人", foreign.CROSS,
        [foreign.Point(1.0, 2.0), foreign.Point(3.0, 4.0)], [[1, 2, 3], [4, 5, 6]], inner,
    )  # fmt: skip
    tree = foreign.Tree("root", [foreign.Tree("leaf", []), foreign.Tree("twig", [foreign.Tree("bud", [])])])
    ring = foreign.Link("a", foreign.Link("b", None))
    ring.next.next = ring
    return {
        "struct": (foreign._tc_Everything, everything),
        "union": (foreign._tc_Choice, foreign.Choice(where=foreign.Point(1.0, 2.0))),
        "enum": (foreign._tc_Mood, foreign.CROSS),
        "recursive": (foreign._tc_Tree, tree),
        "sequence": (foreign._tc_Points, [foreign.Point(1.0, 2.0)]),
        "array": (foreign._tc_Grid, [[1, 2, 3], [4, 5, 6]]),
        "exception": (foreign._tc_Broken, foreign.Broken("wheel")),
        "wstring": (CORBA.TC_wstring, "řeč 机器人"),
        "octets": (foreign._tc_Raw, bytes(range(256))),
        "fixed": (foreign._tc_Price, CORBA.fixed(5, 2, 12345)),
        "string": (CORBA.TC_string, "žluť"),
        "double": (CORBA.TC_double, 0.1),
        "any": (CORBA.TC_any, inner),
        "typecode": (CORBA.TC_TypeCode, foreign._tc_Everything),
        "null": (CORBA.TC_null, None),
        "object reference": (foreign._tc_Robot, robot),
        "nil": (foreign._tc_Robot, None),
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
    if isinstance(value, CORBA.Any):
        return ("any", value.typecode().kind(), told(value.value(), depth + 1))
    if isinstance(value, CORBA.Object):
        return value.greet()
    if isinstance(value, list | tuple):
        return [told(one, depth + 1) for one in value]
    if isinstance(value, omniORB.Union):
        return (told(value._d), told(value._v, depth + 1))
    if isinstance(value, omniORB.EnumItem):
        return (value._n, value._v)
    if hasattr(value, "__dict__"):
        return (type(value).__name__, [(key, told(one, depth + 1)) for key, one in sorted(vars(value).items())])
    return value


def main() -> None:
    uri = sys.argv[1]
    with tempfile.TemporaryDirectory() as folder, Orb(Address("127.0.0.1", 1), call_timeout_s=LIMIT_S) as orb:
        foreign = make_stubs(folder)
        import Foreign__POA  # type: ignore[import-not-found]

        class Robot(Foreign__POA.Robot):  # type: ignore[misc]
            def greet(self) -> str:
                return "I am a robot"

        channel = orb.reference(uri, RoboCorba.EventChannel)
        plain, with_header = Plain(), WithHeader()
        channel.for_consumers().obtain_push_supplier().connect_push_consumer(orb.activate(plain))
        everything = [RoboCorba.Clause([RoboCorba.EventPattern("", "")], 0.0)]
        policy = RoboCorba.QueuePolicy(100, RoboCorba.DISCARD_OLDEST, 0.0)
        channel.subscribe("", orb.activate(with_header), everything, policy)
        puller = channel.for_consumers().obtain_pull_supplier()
        puller.connect_pull_consumer(None)
        supplier = channel.for_suppliers().obtain_push_consumer()
        supplier.connect_push_supplier(None)
        ways: dict[str, Callable[[], Any]] = {
            "pushed": lambda: plain.got.get(timeout=LIMIT_S),
            "with header": lambda: with_header.got.get(timeout=LIMIT_S),
            "pulled": puller.pull,
        }
        for name, (typecode, value) in samples(foreign, orb.activate(Robot())).items():
            sent = CORBA.Any(typecode, value)
            try:
                supplier.push(sent)
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
