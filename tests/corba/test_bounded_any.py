"""An any is read as omniORB reads it, unless it is nested too deep."""

from __future__ import annotations

import contextlib
import itertools
import struct
from collections.abc import Iterator
from typing import Any

import omniORB
import pytest
from omniORB import CORBA
from omniORB import any as anys

from robocorba.corba.conversion import bounded_any
from robocorba.corba.conversion.bounded_any import MAX_DEPTH, TC_ANY, read_bounded
from robocorba.corba.conversion.encoded_types import MAX_DEPTH as MAX_TYPE_DEPTH
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba, RoboCorba__POA

#: What omniORB raises for encodings of no any.
REFUSALS = (CORBA.MARSHAL, CORBA.BAD_PARAM, CORBA.BAD_TYPECODE, CORBA.DATA_CONVERSION, CORBA.NO_IMPLEMENT)
HEAD = b"\1\0\0\0"
#: The encoded type of values: struct Tree { string name; sequence<Tree> children; };
TREE = bytes.fromhex(
    "010000000f000000a0000000010000001500000049444c3a466f726569676e2f547265653a312e3000000000050000005472"
    "65650000000002000000050000006e616d6500616d651200000000000000090000006368696c6472656e0065787415000000"
    "44000000010000001700000049444c3a466f726569676e2f466f726573743a312e30000007000000466f7265737400001300"
    "00001000000001f4347effffffff60ffffff00000000"
)


#: An any of types without repository ids and names: union switch (enum { ONE, TWO }) { case ONE: double;
#: case TWO: enum { ONE, TWO }; }, and its value TWO in the case TWO.
NAMELESS = bytes.fromhex(
    "0100000010000000980000000100000001000000000000000100000000000000110000002800000001000000010000000000"
    "0000010000000000000002000000040000004f4e45000400000054574f00ffffffff02000000000000000100000000000000"
    "0700000001000000010000000000000011000000280000000100000001000000000000000100000000000000020000000400"
    "00004f4e45000400000054574f000100000001000000"
)


@pytest.fixture(scope="module", autouse=True)
def orb() -> Iterator[Orb]:
    """omniORB can't read anything without one."""
    with Orb(Address("127.0.0.1", 2809)) as orb:
        yield orb


def within_each_other(count: int) -> bytes:
    """An any within an any within an any."""
    return HEAD + struct.pack("<I", 11) * count + struct.pack("<I", 0)


def sequences_of_sequences(count: int) -> bytes:
    """An empty sequence of sequences of sequences of numbers."""
    sizes, size = [], 4
    for _ in range(count):
        sizes.append(size + 8)
        size += 16
    heads = b"".join(struct.pack("<II", 19, size) + HEAD for size in reversed(sizes))
    return HEAD + heads + struct.pack("<I", 3) + struct.pack("<I", 0) * (count + 1)


def long_tree(count: int) -> bytes:
    """A value of the type struct Tree { string name; sequence<Tree> children; }, each with one child."""
    name = struct.pack("<I", 1) + b"\0\0\0\0"
    return TREE + (name + struct.pack("<I", 1)) * count + name + struct.pack("<I", 0)


@pytest.mark.parametrize(
    "value",
    [
        CORBA.Any(CORBA.TC_null, None),
        CORBA.Any(CORBA.TC_double, 0.1),
        CORBA.Any(CORBA.TC_string, "žluť"),
        CORBA.Any(CORBA.TC_wstring, "řeč 机器人"),
        CORBA.Any(CORBA.TC_any, CORBA.Any(CORBA.TC_long, 3)),
        CORBA.Any(CORBA.TC_TypeCode, RoboCorba._tc_Element),
        CORBA.Any(RoboCorba._tc_Element, RoboCorba.Element(aNode=RoboCorba.PathNode("n", RoboCorba.XY(1.0, 2.0), ""))),
        CORBA.Any(RoboCorba._tc_ProxyKind, RoboCorba.PULL_CONSUMER),
        CORBA.Any(RoboCorba._tc_EventChannel, None),
        anys.to_any([1, 2, 3]),
        anys.to_any({"a": [1, "x"], "b": anys.to_any(2.5)}),
    ],
    ids=itertools.count(),
)
def test_anys_are_read_as_before(value: Any) -> None:
    encoded = omniORB.cdrMarshal(CORBA.TC_any, value)
    for _ in range(2):  # the second time its type is known
        read = omniORB.cdrUnmarshal(TC_ANY, encoded)
        assert type(read) is CORBA.Any
        assert repr(read) == repr(omniORB.cdrUnmarshal(CORBA.TC_any, encoded)) or "Unknown" in repr(read)
        assert len(omniORB.cdrMarshal(CORBA.TC_any, read)) == len(encoded)


def test_types_may_have_no_repository_id() -> None:
    read = omniORB.cdrUnmarshal(TC_ANY, NAMELESS)
    assert (str(read.value()._d), str(read.value()._v)) == ("TWO", "TWO")
    again = omniORB.cdrUnmarshal(TC_ANY, omniORB.cdrMarshal(CORBA.TC_any, read))
    assert str(again.value()._v) == "TWO"


@pytest.mark.parametrize(
    ("make", "most"), [(within_each_other, MAX_DEPTH), (sequences_of_sequences, MAX_TYPE_DEPTH), (long_tree, MAX_DEPTH)]
)
def test_what_is_nested_too_deep_is_refused(make: Any, most: int) -> None:
    for count in (2 * most, 100_000, 1_000_000):  # the process would end
        with pytest.raises(CORBA.MARSHAL):
            omniORB.cdrUnmarshal(TC_ANY, make(count))
        assert omniORB.cdrUnmarshal(TC_ANY, make(most // 8)) is not None


@pytest.mark.parametrize("kind", [*range(40), 1000, 2**31, 2**32 - 1])
@pytest.mark.parametrize("content", [b"", b"\0", b"\1\0\0\0", b"\xff" * 40, bytes(40), b"\1" + bytes(50)])
def test_what_is_no_any_is_refused(kind: int, content: bytes) -> None:
    """Or read as something."""
    with contextlib.suppress(*REFUSALS):
        omniORB.cdrUnmarshal(TC_ANY, HEAD + struct.pack("<II", kind, len(content)) + content)
    assert omniORB.cdrUnmarshal(TC_ANY, within_each_other(3)) is not None


def doubling(count: int, least: int) -> bytes:
    """An encoded struct of two equal structs of two equal structs, the second of each an indirection. least: the kind
    at the bottom."""

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value) + 1) + value.encode() + bytes(4 - len(value) % 4)

    def encoded(level: int, at: int) -> bytes:
        body = b"\1\0\0\0" + text(f"IDL:S{level}:1.0") + text(f"S{level}") + struct.pack("<I", 2) + text("a")
        inner = at + 8 + len(body)
        body += (encoded(level - 1, inner) if level else struct.pack("<I", least)) + text("b")
        if level:
            body += struct.pack("<Ii", 0xFFFFFFFF, inner - (at + 12 + len(body)))
        else:
            body += struct.pack("<I", least)
        return struct.pack("<II", 15, len(body)) + body

    return encoded(count, 4)


def test_a_short_type_of_endless_values_is_refused() -> None:
    """Its value of no bytes would have 2 ** 40 members."""
    with pytest.raises(REFUSALS):
        omniORB.cdrUnmarshal(TC_ANY, HEAD + doubling(40, least=0))
    value = omniORB.cdrUnmarshal(TC_ANY, HEAD + doubling(2, least=3) + struct.pack("<8i", *range(8)))._v
    assert (value.a.a.a, value.b.b.b) == (0, 7)


def test_types_that_are_refused_are_not_kept() -> None:
    bounded_any._read.cache_clear()
    for number in range(3):
        with pytest.raises(REFUSALS):
            omniORB.cdrUnmarshal(TC_ANY, HEAD + struct.pack("<II", 15, 5000) + bytes([number]) * 5000)
    assert bounded_any._read.cache_info().currsize == 0


def test_servants_read_anys_so() -> None:
    class Consumer(RoboCorba__POA.EventConsumer):
        pass

    before = dict(Consumer._omni_op_d)
    read_bounded(Consumer)
    assert Consumer._omni_op_d["push"][0] == (TC_ANY._d,)
    assert Consumer._omni_op_d["push"][1:] == before["push"][1:]
    assert Consumer._omni_op_d["pushRuns"] == before["pushRuns"]
    assert RoboCorba__POA.EventConsumer._omni_op_d["push"] == before["push"]


def union(labels: tuple[int, int], default: int, enumerators: int = 3) -> bytes:
    """A union of two members by an enumeration."""

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value) + 1) + value.encode() + bytes(4 - len(value) % 4)

    names = b"".join(text(f"e{number}") for number in range(enumerators))
    mood = HEAD + text("IDL:M:1.0") + text("M") + struct.pack("<I", enumerators) + names
    members = b"".join(struct.pack("<I", label) + text("m") + struct.pack("<I", 3) for label in labels)
    content = HEAD + text("IDL:U:1.0") + text("U") + struct.pack("<II", 17, len(mood)) + mood
    content += struct.pack("<iI", default, 2) + members
    return HEAD + struct.pack("<II", 16, len(content)) + content + struct.pack("<II", 1, 7)


@pytest.mark.parametrize(("labels", "default"), [((0, 0), -1), ((0, 3), -1), ((0, 1), 0), ((0, 1), 2), ((0, 1), -2)])
def test_unions_at_which_omniorbpy_crashes_are_refused(labels: tuple[int, int], default: int) -> None:
    with pytest.raises(CORBA.MARSHAL):
        omniORB.cdrUnmarshal(TC_ANY, union(labels, default))
    for right in (-1, 1):
        assert omniORB.cdrUnmarshal(TC_ANY, union((0, 1), right)).value()._v == 7
