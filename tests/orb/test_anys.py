"""Anys and references are read as omniORB reads them, however types are encoded, and refused where it would crash."""

from __future__ import annotations

import contextlib
import itertools
import socket
import struct
import threading
from collections.abc import Iterator
from random import Random
from typing import Any

import omniORB
import pytest
from hypothesis import given
from hypothesis import strategies as st
from omniORB import CORBA
from omniORB import any as anys
from omniORB import tcInternal as tc

from robocorba.errors.events import Refused
from robocorba.errors.services import NotReachable
from robocorba.events.corba.remote_clients import RemotePullSupplier
from robocorba.orb import bounded_any
from robocorba.orb.bounded_any import MAX_DEPTH, TC_ANY, bounded, read_bounded
from robocorba.orb.encoded_types import MAX_DEPTH as MAX_TYPE_DEPTH
from robocorba.orb.orb import Orb
from robocorba.orb.workarounds import DescribedType
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.settings import Address
from testkit.random_anys import INDIRECTIONS, RandomAnys, content

pytestmark = pytest.mark.usefixtures("orb")

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


#: An any of types without repository ids and names: encoded_union switch (enum { ONE, TWO }) { case ONE: double;
#: case TWO: enum { ONE, TWO }; }, and its value TWO in the case TWO.
NAMELESS = bytes.fromhex(
    "0100000010000000980000000100000001000000000000000100000000000000110000002800000001000000010000000000"
    "0000010000000000000002000000040000004f4e45000400000054574f00ffffffff02000000000000000100000000000000"
    "0700000001000000010000000000000011000000280000000100000001000000000000000100000000000000020000000400"
    "00004f4e45000400000054574f000100000001000000"
)


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


#: Of types with stubs here, which other random ones have not, and as programs make them.
ANYS = [
    *(CORBA.Any(CORBA.TC_TypeCode, RoboCorba._tc_Element), CORBA.Any(CORBA.TC_wstring, "řeč 机器人")),
    CORBA.Any(RoboCorba._tc_Element, RoboCorba.Element(aNode=RoboCorba.PathNode("n", RoboCorba.XY(1.0, 2.0), ""))),
    *(CORBA.Any(RoboCorba._tc_ProxyKind, RoboCorba.PULL_CONSUMER), CORBA.Any(RoboCorba._tc_EventChannel, None)),
    *(anys.to_any([1, 2, 3]), anys.to_any({"a": [1, "x"], "b": anys.to_any(2.5)})),
]


@pytest.mark.parametrize("value", ANYS, ids=itertools.count())
def test_anys_are_read_as_before(value: Any) -> None:
    encoded = omniORB.cdrMarshal(CORBA.TC_any, value)
    for _ in range(2):  # the second time its type is known
        read = omniORB.cdrUnmarshal(TC_ANY, encoded)
        assert type(read) is CORBA.Any
        assert repr(read) == repr(omniORB.cdrUnmarshal(CORBA.TC_any, encoded)) or "Unknown" in repr(read)
        assert len(omniORB.cdrMarshal(CORBA.TC_any, read)) == len(encoded)


def test_types_without_ids_and_wide_characters() -> None:
    read = omniORB.cdrUnmarshal(TC_ANY, NAMELESS)
    assert (str(read.value()._d), str(read.value()._v)) == ("TWO", "TWO")
    again = omniORB.cdrUnmarshal(TC_ANY, omniORB.cdrMarshal(CORBA.TC_any, read))
    assert str(again.value()._v) == "TWO"
    names = [f"member_{number}" for number in range(5000)]
    created = omniORB.createUnknownStruct("IDL:F/Long:1.0", tuple(names))
    members = [each for name in names for each in (name, tc.tv_long)]
    sent = CORBA.Any(
        tc.createTypeCode((tc.tv_struct, created, "IDL:F/Long:1.0", "Long", *members)), created(*range(5000))
    )
    assert content(omniORB.cdrUnmarshal(TC_ANY, omniORB.cdrMarshal(CORBA.TC_any, sent))) == content(sent)
    # omniORBpy takes the first octet, which is the size, for the character.
    for octets, character in (
        *(("あ".encode(encoding), "あ") for encoding in ("utf-16-be", "utf-16")),
        *((b"\xfe\xff\x30\x42", "あ"), (b"\xd8\x3d", "\ufffd")),
    ):
        assert omniORB.cdrUnmarshal(TC_ANY, encoded_wchar(octets)).value() == character
    for octets in (b"", b"a", b"abc", b"abcde"):
        with pytest.raises(CORBA.MARSHAL):
            omniORB.cdrUnmarshal(TC_ANY, encoded_wchar(octets))


@pytest.mark.parametrize(
    ("make", "most"), [(within_each_other, MAX_DEPTH), (sequences_of_sequences, MAX_TYPE_DEPTH), (long_tree, MAX_DEPTH)]
)
def test_what_is_nested_too_deep_is_refused(make: Any, most: int) -> None:
    for count in (2 * most, 100_000, 1_000_000):  # the process would end
        with pytest.raises(CORBA.MARSHAL):
            omniORB.cdrUnmarshal(TC_ANY, make(count))
        assert omniORB.cdrUnmarshal(TC_ANY, make(most // 8)) is not None


@pytest.mark.parametrize("kind", [*range(40), 1000, 2**31, 2**32 - 1])
def test_what_is_no_any_is_refused(kind: int) -> None:
    """Or read as something."""
    for octets in (b"", b"\0", b"\1\0\0\0", b"\xff" * 40, bytes(40), b"\1" + bytes(50)):
        with contextlib.suppress(*REFUSALS):
            omniORB.cdrUnmarshal(TC_ANY, HEAD + struct.pack("<II", kind, len(octets)) + octets)
        assert omniORB.cdrUnmarshal(TC_ANY, within_each_other(3)) is not None


def doubling(count: int, least: int) -> bytes:
    """An encoded struct of two equal structs of two equal structs, the second of each an indirection. least: the kind
    at the bottom."""

    def encoded(level: int, at: int) -> bytes:
        body = HEAD + encoded_text(f"IDL:S{level}:1.0") + encoded_text(f"S{level}") + struct.pack("<I", 2)
        body += encoded_text("a")
        inner = at + 8 + len(body)
        body += (encoded(level - 1, inner) if level else struct.pack("<I", least)) + encoded_text("b")
        again = ("<Ii", 0xFFFFFFFF, inner - (at + 12 + len(body))) if level else ("<I", least)
        body += struct.pack(*again)
        return struct.pack("<II", 15, len(body)) + body

    return encoded(count, 4)


def test_types_of_endless_values_and_unions_at_which_omniorbpy_crashes_are_refused() -> None:
    """Its value of no bytes would have 2 ** 40 members."""
    with pytest.raises(REFUSALS):
        omniORB.cdrUnmarshal(TC_ANY, HEAD + doubling(40, least=0))
    value = omniORB.cdrUnmarshal(TC_ANY, HEAD + doubling(2, least=3) + struct.pack("<8i", *range(8)))._v
    assert (value.a.a.a, value.b.b.b) == (0, 7)
    bounded_any._read.cache_clear()
    for number in range(3):
        with pytest.raises(REFUSALS):
            omniORB.cdrUnmarshal(TC_ANY, HEAD + struct.pack("<II", 15, 5000) + bytes([number]) * 5000)
    assert bounded_any._read.cache_info().currsize == 0
    for labels, default in (((0, 0), -1), ((0, 3), -1), ((0, 1), 0), ((0, 1), 2), ((0, 1), -2)):
        with pytest.raises(CORBA.MARSHAL):
            omniORB.cdrUnmarshal(TC_ANY, encoded_union(labels, default))
    for right in (-1, 1):
        assert omniORB.cdrUnmarshal(TC_ANY, encoded_union((0, 1), right)).value()._v == 7


def encoded_union(labels: tuple[int, int], default: int, enumerators: int = 3) -> bytes:
    """A encoded_union of two members by an enumeration."""

    names = b"".join(encoded_text(f"e{number}") for number in range(enumerators))
    mood = HEAD + encoded_text("IDL:M:1.0") + encoded_text("M") + struct.pack("<I", enumerators) + names
    members = b"".join(struct.pack("<I", label) + encoded_text("m") + struct.pack("<I", 3) for label in labels)
    content = HEAD + encoded_text("IDL:U:1.0") + encoded_text("U") + struct.pack("<II", 17, len(mood)) + mood
    content += struct.pack("<iI", default, 2) + members
    return HEAD + struct.pack("<II", 16, len(content)) + content + struct.pack("<II", 1, 7)


@pytest.fixture(scope="module")
def reference(orb: Orb) -> Any:
    return orb.reference("corbaloc:iiop:127.0.0.1:1/x", CORBA.Object)


@given(st.randoms(use_true_random=False))
def test_any_type_and_value_is_read_however_an_orb_encodes_it(reference: Any, random: Random) -> None:
    """C++ programs write an indirection wherever a type comes again, omniORBpy for some types, others for none."""
    value = RandomAnys(random, [reference]).any()
    encoded = omniORB.cdrMarshal(CORBA.TC_any, value)
    read = omniORB.cdrUnmarshal(TC_ANY, encoded)
    assert content(read) == content(value)
    assert len(omniORB.cdrMarshal(CORBA.TC_any, read)) == len(encoded)
    assert content(omniORB.cdrUnmarshal(TC_ANY, encoded_any(value, random))) == content(value)


@pytest.mark.parametrize("kind", [tc.tv_objref, tc.tv_abstract_interface])
def test_a_reference_may_be_of_another_interface_than_the_type(kind: int, reference: Any) -> None:
    """The interface of the type has no stubs here, the one of the reference has some: omniORBpy ends the process."""
    editor = reference._narrow(CORBA.Object)._unchecked_narrow(RoboCorba.MapEditor)
    for each in (reference, editor):
        sent = CORBA.Any(tc.createTypeCode((kind, "IDL:F/I:1.0", "I")), each)
        read = omniORB.cdrUnmarshal(TC_ANY, omniORB.cdrMarshal(CORBA.TC_any, sent))
        assert read.value()._is_equivalent(each)
        assert read.typecode().id() == "IDL:F/I:1.0"


#: Types of references, and profiles, that no ORB sends.
TYPES = [b"\xff\xfe\0", b"abc\xc3\0", b"a\0b\0", b"abc"]
PROFILES = [b"\0\0\0\0", b"\1\0\0\0\1\0\0\0\4\0\0\0\1\1\2\0"]
#: The type of a GIOP message that asks whether an object is there.
LOCATE_REQUEST = 3
TC_OBJECT = DescribedType(bounded(CORBA.TC_Object._d))
TC_EDITOR = DescribedType(bounded(RoboCorba._d_MapEditor))


def encoded_reference(type: bytes, profiles: bytes) -> bytes:
    """Little-endian, without the octet that says so."""
    return struct.pack("<I", len(type)) + type + bytes(-len(type) % 4) + profiles


@pytest.mark.parametrize("type", TYPES, ids=repr)
@pytest.mark.parametrize("profiles", PROFILES, ids=repr)
def test_references_at_which_omniorbpy_crashes_are_refused(orb: Orb, type: bytes, profiles: bytes) -> None:
    encoded = encoded_reference(type, profiles)
    for reader, head in ((TC_OBJECT, b"\1\0\0\0"), (TC_EDITOR, b"\1\0\0\0"), (TC_ANY, any_head())):
        with pytest.raises(CORBA.MARSHAL):
            omniORB.cdrUnmarshal(reader, head + encoded)
    with pytest.raises(NotReachable):
        orb.reference("IOR:01000000" + encoded.hex(), RoboCorba.MapEditor)


def any_head() -> bytes:
    """The type of a reference in an any."""
    return omniORB.cdrMarshal(CORBA.TC_any, CORBA.Any(CORBA.TC_Object, None))[:-12]


@pytest.mark.parametrize("big_endian", [True, False])
@pytest.mark.parametrize("type", [b"", b"\0", b"IDL:RoboCorba/MapEditor:1.0\0", "IDL:Žluť:1.0\0".encode()], ids=repr)
def test_other_references_are_read_as_before(orb: Orb, type: bytes, big_endian: bool) -> None:
    known = orb.reference("corbaloc::1.2.3.4:5/abc", CORBA.Object)
    profiles = omniORB.cdrMarshal(CORBA.TC_Object, known, 1)[8:]
    made = omniORB.cdrUnmarshal(CORBA.TC_Object, encoded_reference(type, profiles), 1)
    encoded = omniORB.cdrMarshal(CORBA.TC_Object, made, not big_endian)
    for reader in (TC_OBJECT, TC_EDITOR):
        read = omniORB.cdrUnmarshal(reader, encoded, not big_endian)
        assert read._is_equivalent(known)
        assert len(omniORB.cdrMarshal(CORBA.TC_Object, read)) == len(encoded) + 4
    assert isinstance(read, RoboCorba._objref_MapEditor)
    in_an_any = any_head() + encoded_reference(b"IDL:RoboCorba/MapEditor:1.0\0", PROFILES[1])
    assert isinstance(omniORB.cdrUnmarshal(TC_ANY, in_an_any).value(), RoboCorba._objref_MapEditor)
    is_nil = omniORB.cdrUnmarshal(TC_OBJECT, encoded_reference(type, bytes(4)), 1) is None
    assert is_nil == (len(type) <= 1)


def parts(descriptor: Any) -> Iterator[Any]:
    """The kinds in a descriptor, but not those within what is bounded."""
    if isinstance(descriptor, tuple) and descriptor[0] == tc.tv_struct and "Bounded" in descriptor[2]:
        return
    yield descriptor[0] if isinstance(descriptor, tuple) else descriptor
    if not isinstance(descriptor, tuple):
        return
    inner: list[Any] = []
    bounded_any._rebuilt(descriptor, inner.append)
    for part in inner:
        yield from parts(part)


@pytest.mark.parametrize("name", [name for name, kind in vars(RoboCorba__POA).items() if hasattr(kind, "_omni_op_d")])
def test_no_servant_reads_a_reference_or_an_any_otherwise(name: str) -> None:
    servant = type(name, (getattr(RoboCorba__POA, name),), {})
    read_bounded(servant)
    kinds = {kind for wanted, *_ in servant._omni_op_d.values() for each in wanted for kind in parts(each)}
    assert not kinds & {tc.tv_objref, tc.tv_any, tc.tv_TypeCode, tc.tv_value}


@contextlib.contextmanager
def answering(body: bytes) -> Iterator[str]:
    """The address of a server that answers each request of its first client with these octets."""

    def serve() -> None:
        connection, _ = listener.accept()
        with connection, connection.makefile("rb") as requests:
            while header := requests.read(12):
                request = requests.read(struct.unpack("<I", header[8:])[0])
                is_here = header[7] == LOCATE_REQUEST
                kind, answer = (4, struct.pack("<I", 1)) if is_here else (1, bytes(8) + body)
                size = struct.pack("<I", 4 + len(answer))
                connection.sendall(b"GIOP\1\2\1" + bytes([kind]) + size + request[:4] + answer)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"127.0.0.1:{listener.getsockname()[1]}"


@pytest.mark.parametrize("type", TYPES, ids=repr)
def test_foreign_suppliers_and_naming_services_harm_nobody(orb: Orb, type: bytes) -> None:
    answer = encoded_reference(type, PROFILES[1])
    with answering(any_head()[4:] + answer + b"\1") as supplier:
        client = RemotePullSupplier(orb, f"corbaloc::1.2@{supplier}/x")
        with pytest.raises(Refused):
            client.try_pull(10.0)
    with answering(answer) as naming, pytest.raises(NotReachable):
        orb.reference(f"corbaname::1.2@{naming}#a", RoboCorba.MapEditor)
    with answering(answer) as naming, pytest.raises(NotReachable):
        orb.resolve_in_other_naming_service(Address.parse(naming), "a", RoboCorba.MapEditor, 10.0)


def test_values_are_refused_unless_all_clients_are_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    content = HEAD + encoded_text("IDL:Val:1.0") + encoded_text("Val") + struct.pack("<III", 0, 0, 1)
    content += encoded_text("x") + struct.pack("<IH", tc.tv_long, 1)
    head = HEAD + struct.pack("<II", tc.tv_value, len(content)) + content + bytes(-len(content) % 4)
    value, nil = struct.pack("<II", 0x7FFFFF00, 7), struct.pack("<I", 0)
    assert omniORB.cdrUnmarshal(TC_ANY, head + nil).value() is None
    for refused in (value, struct.pack("<II", 0x7FFFFF06, 0), struct.pack("<IIII", 0x7FFFFF02, 0, 0, 0)):
        with pytest.raises(CORBA.MARSHAL):  # the last two end the process otherwise
            omniORB.cdrUnmarshal(TC_ANY, head + refused)
    bounded_any._read.cache_clear()
    monkeypatch.setenv("ROBOCORBA_VALUETYPES", "1")
    assert omniORB.cdrUnmarshal(TC_ANY, head + value).value().x == 7
    bounded_any._read.cache_clear()


_LABELS = {
    **{tc.tv_short: "h", tc.tv_ushort: "H", tc.tv_long: "i", tc.tv_ulong: "I", tc.tv_longlong: "q"},
    **{tc.tv_ulonglong: "Q", tc.tv_boolean: "B", tc.tv_char: "B", tc.tv_enum: "I"},
}


def encoded_any(value: Any, random: Random) -> bytes:
    """An encapsulated `any`."""
    type_code = b"\1\0\0\0" + _Types(random).encoded(value._t._d, 4, "<")
    before = (tc.tv_array, tc.tv_octet, len(type_code))
    pair = (tc.tv_struct, omniORB.createUnknownStruct("", ("a", "b")), "", "", "a", before, "b", value._t._d)
    whole: bytes = omniORB.cdrMarshal(tc.createTypeCode(pair), pair[1](type_code, value._v), 1)  # no encapsulation
    return whole


class _Types:
    def __init__(self, random: Random) -> None:
        self._random = random
        #: Where each type begins, and which types are around.
        self._places: dict[int, int] = {}
        self._around: list[Any] = []

    def encoded(self, descriptor: Any, at: int, order: str) -> bytes:
        """The encoding that begins `at` this many bytes, with the byte order of the encapsulation around."""
        if not isinstance(descriptor, tuple):
            return struct.pack(f"{order}I", descriptor)
        if descriptor[0] in INDIRECTIONS:
            return self.encoded(descriptor[1][0], at, order)
        place = self._places.get(id(descriptor))
        is_around = any(each is descriptor for each in self._around)
        if place is not None and (is_around or self._random.random() < 0.8):
            return struct.pack(f"{order}Ii", 2**32 - 1, place - at - 4)
        self._places[id(descriptor)] = at
        kind = descriptor[0]
        if kind in (tc.tv_string, tc.tv_wstring):
            return struct.pack(f"{order}II", *descriptor)
        if kind == tc.tv_fixed:
            return struct.pack(f"{order}IHh", *descriptor)
        self._around.append(descriptor)
        body = _Encapsulation(self._random.choice("<>"), at + 8)
        self._content(body, descriptor)
        self._around.pop()
        return struct.pack(f"{order}II", kind, len(body.data)) + body.data

    def _content(self, body: _Encapsulation, descriptor: Any) -> None:
        kind = descriptor[0]

        def part(each: Any) -> None:
            body.align(4)
            body.data += self.encoded(each, body.at, body.order)

        def member(name: str, each: Any) -> None:
            body.text(name.removeprefix("_"))
            part(each)

        if kind in (tc.tv_sequence, tc.tv_array):
            part(descriptor[1])
            body.number("I", descriptor[2])
            return
        for name in descriptor[2:4] if kind in (tc.tv_struct, tc.tv_except, tc.tv_union) else descriptor[1:3]:
            body.text(name)
        if kind == tc.tv_alias:
            part(descriptor[3])
        elif kind == tc.tv_enum:
            body.number("I", len(descriptor[3]))
            for item in descriptor[3]:
                body.text(item._n)
        elif kind in (tc.tv_struct, tc.tv_except):
            body.number("I", len(descriptor[4:]) // 2)
            for name, each in zip(descriptor[4::2], descriptor[5::2], strict=True):
                member(name, each)
        elif kind == tc.tv_union:
            discriminator, default, cases = descriptor[4:7]
            part(discriminator)
            body.number("i", default)
            body.number("I", len(cases))
            while isinstance(discriminator, tuple) and discriminator[0] == tc.tv_alias:
                discriminator = discriminator[3]
            label_kind = discriminator[0] if isinstance(discriminator, tuple) else discriminator
            for label, name, each in cases:
                number = label._v if label_kind == tc.tv_enum else ord(label) if label_kind == tc.tv_char else label
                body.number(_LABELS[label_kind], number)
                member(name, each)


class _Encapsulation:
    def __init__(self, order: str, begin: int) -> None:
        self.order, self._begin = order, begin
        self.data = b"\1" if order == "<" else b"\0"

    @property
    def at(self) -> int:
        """Where the next octet comes, counted from the beginning of the outermost encapsulation."""
        return self._begin + len(self.data)

    def align(self, size: int) -> None:
        self.data += bytes(-len(self.data) % size)

    def number(self, format: str, value: int) -> None:
        self.align(struct.calcsize(f"<{format}"))
        self.data += struct.pack(self.order + format, value)

    def text(self, value: str) -> None:
        self.number("I", len(value) + 1)
        self.data += value.encode() + b"\0"


def encoded_text(value: str) -> bytes:
    """Little-endian, with a NUL, filled up to four octets."""
    return struct.pack("<I", len(value) + 1) + value.encode() + bytes(4 - len(value) % 4)


def encoded_wchar(octets: bytes) -> bytes:
    """An encapsulated `any` with a wide character of these octets."""
    return b"\1\0\0\0" + struct.pack("<IB", CORBA.TC_wchar._d, len(octets)) + octets
