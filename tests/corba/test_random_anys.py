"""An any of any IDL type is read as it was sent, however its type is encoded."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random
from typing import Any

import omniORB
import pytest
from hypothesis import given
from hypothesis import strategies as st
from omniORB import CORBA
from omniORB import tcInternal as tc

from robocorba.corba.conversion.bounded_any import TC_ANY
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.testing.random_anys import RandomAnys, content
from tests.corba.type_encoding import encoded_any, encoded_wchar

OBJECT = "corbaloc:iiop:127.0.0.1:1/x"


@pytest.fixture(scope="module")
def reference() -> Iterator[Any]:
    with Orb(Address("127.0.0.1", 2809)) as orb:
        yield orb.reference(OBJECT, CORBA.Object)


@given(st.randoms(use_true_random=False))
def test_any_type_and_value_is_read(reference: Any, random: Random) -> None:
    value = RandomAnys(random, [reference]).any()
    encoded = omniORB.cdrMarshal(CORBA.TC_any, value)
    read = omniORB.cdrUnmarshal(TC_ANY, encoded)
    assert content(read) == content(value)
    assert len(omniORB.cdrMarshal(CORBA.TC_any, read)) == len(encoded)


@given(st.randoms(use_true_random=False))
def test_types_may_be_encoded_as_by_any_orb(reference: Any, random: Random) -> None:
    """C++ programs write an indirection wherever a type comes again, omniORBpy for some types, others for none."""
    value = RandomAnys(random, [reference]).any()
    assert content(omniORB.cdrUnmarshal(TC_ANY, encoded_any(value, random))) == content(value)


POINT = (tc.tv_struct, omniORB.createUnknownStruct("IDL:F/P:1.0", ("x",)), "IDL:F/P:1.0", "P", "x", tc.tv_double)
COLOUR = (tc.tv_enum, "IDL:F/C:1.0", "C", (omniORB.EnumItem("RED", 0), omniORB.EnumItem("GREEN", 1)))
for item in COLOUR[3]:
    item._parent_id = COLOUR[1]


@pytest.mark.parametrize(
    ("repeated", "value"),
    [
        (POINT, POINT[1](1.5)),
        ((tc.tv_alias, "IDL:F/Name:1.0", "Name", (tc.tv_string, 0)), "Čapek"),
        ((tc.tv_alias, "IDL:F/Path:1.0", "Path", (tc.tv_sequence, POINT, 0)), [POINT[1](1.0), POINT[1](2.0)]),
        (COLOUR, COLOUR[3][1]),
        ((tc.tv_alias, "IDL:F/Row:1.0", "Row", (tc.tv_array, tc.tv_double, 2)), [0.5, 0.25]),
        ((tc.tv_objref, "IDL:F/I:1.0", "I"), None),
        ((tc.tv_sequence, tc.tv_long, 0), [1, 2]),
        ((tc.tv_string, 7), "abc"),
    ],
    ids=["struct", "alias", "alias of sequence", "enum", "array", "interface", "sequence", "string"],
)
def test_a_struct_may_have_two_members_of_a_type(repeated: Any, value: Any, reference: Any) -> None:
    """As in struct { Name first; Name last; }."""
    created = omniORB.createUnknownStruct("IDL:F/Two:1.0", ("a", "b"))
    pair = (tc.tv_struct, created, "IDL:F/Two:1.0", "Two", "a", repeated, "b", repeated)
    sent = CORBA.Any(tc.createTypeCode(pair), created(value, value))
    for encoded in (omniORB.cdrMarshal(CORBA.TC_any, sent), *(encoded_any(sent, Random(seed)) for seed in range(8))):
        assert content(omniORB.cdrUnmarshal(TC_ANY, encoded)) == content(sent)


def test_a_type_may_have_thousands_of_members(reference: Any) -> None:
    names = [f"member_{number}" for number in range(5000)]
    created = omniORB.createUnknownStruct("IDL:F/Long:1.0", tuple(names))
    members = [each for name in names for each in (name, tc.tv_long)]
    sent = CORBA.Any(
        tc.createTypeCode((tc.tv_struct, created, "IDL:F/Long:1.0", "Long", *members)), created(*range(5000))
    )
    assert content(omniORB.cdrUnmarshal(TC_ANY, omniORB.cdrMarshal(CORBA.TC_any, sent))) == content(sent)


@pytest.mark.parametrize("kind", [tc.tv_objref, tc.tv_abstract_interface])
def test_a_reference_may_be_of_another_interface_than_the_type(kind: int, reference: Any) -> None:
    """The interface of the type has no stubs here, the one of the reference has some: omniORBpy ends the process."""
    editor = reference._narrow(CORBA.Object)._unchecked_narrow(RoboCorba.MapEditor)
    for each in (reference, editor):
        sent = CORBA.Any(tc.createTypeCode((kind, "IDL:F/I:1.0", "I")), each)
        read = omniORB.cdrUnmarshal(TC_ANY, omniORB.cdrMarshal(CORBA.TC_any, sent))
        assert read.value()._is_equivalent(each)
        assert read.typecode().id() == "IDL:F/I:1.0"


@pytest.mark.parametrize(
    ("octets", "character"),
    [
        ("あ".encode("utf-16-be"), "あ"),
        ("あ".encode("utf-16"), "あ"),
        (b"\xfe\xff\x30\x42", "あ"),
        (b"\xd8\x3d", "\ufffd"),
    ],
)
def test_wide_characters_are_read(octets: bytes, character: str, reference: Any) -> None:
    """omniORBpy takes the first octet, which is the size, for the character."""
    assert omniORB.cdrUnmarshal(TC_ANY, encoded_wchar(octets)).value() == character


@pytest.mark.parametrize("octets", [b"", b"a", b"abc", b"abcde"])
def test_wide_characters_of_no_size_are_refused(octets: bytes, reference: Any) -> None:
    with pytest.raises(CORBA.MARSHAL):
        omniORB.cdrUnmarshal(TC_ANY, encoded_wchar(octets))
