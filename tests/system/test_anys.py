"""Events that omniORBpy can't read, pushed to a consumer in another process, which goes on."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import omniORB
import pytest
from omniORB import CORBA
from omniORB import tcInternal as tc

import CosEventComm  # isort: skip  (found once omniORB is imported)

from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.supervision.launch import ChildProcess
from robocorba.testing.fuzzing.wire import OCTETS, in_turn
from robocorba.testing.processes import Launcher

pytestmark = [pytest.mark.system, pytest.mark.full]

SERVER = (sys.executable, str(Path(__file__).with_name("any_consumer.py")))
#: The type of a valuetype without members.
VALUE = tc.createTypeCode(
    (tc.tv_value, omniORB.UnknownValueBase, "IDL:Foreign/Val:1.0", "Val", CORBA.VM_NONE, None, tc.tv_null)
)


def ulongs(*numbers: int) -> Any:
    """Numbers one after the other, in one array."""
    return (tc.tv_array, tc.tv_ulong, len(numbers)), list(numbers)


def nested_types(count: int) -> Any:
    """The beginning of sequences of sequences, each an encapsulation in big-endian order."""
    sizes = [8 + 16 * number for number in range(count, 0, -1)]
    return ulongs(*(number for size in sizes for number in (tc.tv_sequence, size, 0)), *[0] * (count + 2))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ChildProcess]:
    with Launcher(tmp_path_factory.mktemp("anys")) as launch:
        yield launch(*SERVER)


@pytest.fixture(scope="module")
def consumer(server: ChildProcess) -> Iterator[Any]:
    assert server.stdout
    with Orb(Address("127.0.0.1", 1)) as orb:
        yield orb.reference(server.stdout.readline().strip(), CosEventComm.PushConsumer)


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
    server: ChildProcess, consumer: Any, descriptor: Any, value: Any
) -> None:
    _, returned, raised = CosEventComm.PushConsumer._d_push
    with pytest.raises(CORBA.MARSHAL):
        consumer._obj.invoke("push", ((descriptor,), returned, raised), (value,))
    consumer.push(CORBA.Any(CORBA.TC_any, CORBA.Any(CORBA.TC_string, "ナビ")))
    assert server.stdout and "ナビ" in server.stdout.readline()
    assert server.poll() is None
