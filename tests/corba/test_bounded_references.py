"""A reference is read as omniORB reads it, unless its type is no text: omniORBpy would end the process."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections.abc import Iterator
from typing import Any

import CosNaming
import omniORB
import pytest
from omniORB import CORBA
from omniORB import tcInternal as tc

from robocorba.corba.conversion import bounded_any
from robocorba.corba.conversion.bounded_any import TC_ANY, bounded, read_bounded
from robocorba.corba.conversion.references import BoundedTypeCode
from robocorba.corba.orb import Orb
from robocorba.corba.remote.event_clients import RemotePullSupplier
from robocorba.corba.servants.event_channel import CallbackRouteServant
from robocorba.errors.events import Refused
from robocorba.errors.services import NotReachable
from robocorba.settings import Address
from robocorba.stubs import RoboCorba, RoboCorba__POA

#: Types of references, and profiles, that no ORB sends.
TYPES = [b"\xff\xfe\0", b"abc\xc3\0", b"a\0b\0", b"abc"]
PROFILES = [b"\0\0\0\0", b"\1\0\0\0\1\0\0\0\4\0\0\0\1\1\2\0"]
#: The type of a GIOP message that asks whether an object is there.
LOCATE_REQUEST = 3
TC_OBJECT = BoundedTypeCode(bounded(CORBA.TC_Object._d))
TC_EDITOR = BoundedTypeCode(bounded(RoboCorba._d_MapEditor))


@pytest.fixture(scope="module", autouse=True)
def orb() -> Iterator[Orb]:
    with Orb(Address("127.0.0.1", 2809)) as orb:
        yield orb


def reference(type: bytes, profiles: bytes) -> bytes:
    """Little-endian, without the octet that says so."""
    return struct.pack("<I", len(type)) + type + bytes(-len(type) % 4) + profiles


@pytest.mark.parametrize("type", TYPES, ids=repr)
@pytest.mark.parametrize("profiles", PROFILES, ids=repr)
def test_references_at_which_omniorbpy_crashes_are_refused(orb: Orb, type: bytes, profiles: bytes) -> None:
    encoded = reference(type, profiles)
    for reader, head in ((TC_OBJECT, b"\1\0\0\0"), (TC_EDITOR, b"\1\0\0\0"), (TC_ANY, any_head())):
        with pytest.raises(CORBA.MARSHAL):
            omniORB.cdrUnmarshal(reader, head + encoded)
    with pytest.raises(NotReachable):
        orb.reference("IOR:01000000" + encoded.hex(), RoboCorba.MapEditor)


def test_an_any_with_a_reference_is_read() -> None:
    encoded = any_head() + reference(b"IDL:RoboCorba/MapEditor:1.0\0", PROFILES[1])
    assert isinstance(omniORB.cdrUnmarshal(TC_ANY, encoded).value(), RoboCorba._objref_MapEditor)


def any_head() -> bytes:
    """The type of a reference in an any."""
    return omniORB.cdrMarshal(CORBA.TC_any, CORBA.Any(CORBA.TC_Object, None))[:-12]


@pytest.mark.parametrize("big_endian", [True, False])
@pytest.mark.parametrize("type", [b"", b"\0", b"IDL:RoboCorba/MapEditor:1.0\0", "IDL:Žluť:1.0\0".encode()], ids=repr)
def test_other_references_are_read_as_before(orb: Orb, type: bytes, big_endian: bool) -> None:
    known = orb.reference("corbaloc::1.2.3.4:5/abc", CORBA.Object)
    profiles = omniORB.cdrMarshal(CORBA.TC_Object, known, 1)[8:]
    made = omniORB.cdrUnmarshal(CORBA.TC_Object, reference(type, profiles), 1)
    encoded = omniORB.cdrMarshal(CORBA.TC_Object, made, not big_endian)
    for reader in (TC_OBJECT, TC_EDITOR):
        read = omniORB.cdrUnmarshal(reader, encoded, not big_endian)
        assert read._is_equivalent(known)
        assert len(omniORB.cdrMarshal(CORBA.TC_Object, read)) == len(encoded) + 4
    assert isinstance(read, RoboCorba._objref_MapEditor)
    is_nil = omniORB.cdrUnmarshal(TC_OBJECT, reference(type, bytes(4)), 1) is None
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


def test_a_reference_that_comes_with_its_connection_is_read_by_the_orb() -> None:
    before = RoboCorba__POA.CallbackRoute._omni_op_d["keep"]
    read_bounded(CallbackRouteServant)
    assert CallbackRouteServant._omni_op_d["keep"] == before


def test_answers_are_read_so(orb: Orb) -> None:
    assert bounded_any._with_bounded_answers(CosNaming.NamingContext, "list")[2] is None
    _, (found,), raised = bounded_any._with_bounded_answers(CosNaming.NamingContext, "resolve")
    assert found == bounded(CORBA.TC_Object._d) != CORBA.TC_Object._d
    assert tc.tv_objref not in {kind for each in raised.values() for kind in parts(each)}


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
    answer = reference(type, PROFILES[1])
    with answering(any_head()[4:] + answer + b"\1") as supplier:
        client = RemotePullSupplier(orb, f"corbaloc::1.2@{supplier}/x")
        with pytest.raises(Refused):
            client.try_pull(10.0)
    with answering(answer) as naming, pytest.raises(NotReachable):
        orb.reference(f"corbaname::1.2@{naming}#a", RoboCorba.MapEditor)
    with answering(answer) as naming, pytest.raises(NotReachable):
        orb.resolve_in_other_naming_service(Address.parse(naming), "a", RoboCorba.MapEditor, 10.0)


def test_values_are_refused_unless_all_clients_are_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    def text(value: bytes) -> bytes:
        return struct.pack("<I", len(value) + 1) + value + bytes(4 - len(value) % 4)

    content = b"\1\0\0\0" + text(b"IDL:Val:1.0") + text(b"Val") + struct.pack("<III", 0, 0, 1)
    content += text(b"x") + struct.pack("<IH", tc.tv_long, 1)
    head = b"\1\0\0\0" + struct.pack("<II", tc.tv_value, len(content)) + content + bytes(-len(content) % 4)
    value, nil = struct.pack("<II", 0x7FFFFF00, 7), struct.pack("<I", 0)
    assert omniORB.cdrUnmarshal(TC_ANY, head + nil).value() is None
    for refused in (value, struct.pack("<II", 0x7FFFFF06, 0), struct.pack("<IIII", 0x7FFFFF02, 0, 0, 0)):
        with pytest.raises(CORBA.MARSHAL):  # the last two end the process otherwise
            omniORB.cdrUnmarshal(TC_ANY, head + refused)
    bounded_any._read.cache_clear()
    monkeypatch.setenv("ROBOCORBA_VALUETYPES", "1")
    assert omniORB.cdrUnmarshal(TC_ANY, head + value).value().x == 7
    bounded_any._read.cache_clear()
