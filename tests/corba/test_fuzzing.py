"""The arguments that `python -m bench.chaos.fuzz` makes for every operation of the IDL."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import omniORB
import pytest
from omniORB import tcInternal as tc

from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.testing.fuzzing.operations import interfaces, operations
from robocorba.testing.fuzzing.values import Seen, Values
from robocorba.testing.fuzzing.wire import Wire

INPUTS = 3


@pytest.fixture(scope="module", autouse=True)
def orb() -> Iterator[Orb]:
    with Orb(Address("127.0.0.1", 2809)) as orb:
        yield orb


@pytest.mark.parametrize("interface", list(interfaces()), ids=lambda each: str(each._NP_RepositoryId))
def test_an_orb_can_send_all_arguments(interface: object) -> None:
    for operation in operations(interface):
        random = Random(operation.name)
        values, wire = Values(random, Seen(["L1", "A"])), Wire(random)
        for _ in range(INPUTS):
            arguments = values.arguments(operation.wanted, ())
            assert len(arguments) == len(operation.wanted)
            for descriptor, value in (
                *zip(operation.wanted, arguments, strict=True),
                *zip(*wire.ill_formed(operation.wanted, arguments), strict=True),
            ):
                omniORB.cdrMarshal(tc.createTypeCode(descriptor), value)
