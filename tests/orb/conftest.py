"""The ORB of a test file."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from robocorba.orb.orb import Orb
from robocorba.system.settings import Address


@pytest.fixture(scope="module")
def orb() -> Iterator[Orb]:
    """One without a naming service. omniORB can't encode anything without an ORB."""
    with Orb(Address("127.0.0.1", 9)) as orb:
        yield orb
