"""Type descriptors by which omniORBpy reads values in steps, each chosen after the one before.

A value is described as a struct. omniORBpy calls the constructor of a struct as soon as its members are read; here it
is a function, which chooses the descriptor of the member that is read next. This is safe because no other thread runs
in between. An exception in such a function would not reach the caller as MARSHAL; it chooses REFUSED instead.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robocorba.orb.workarounds import tc

OCTETS = (tc.tv_sequence, tc.tv_octet, 0)
#: Nothing can be read as this, so the call fails with MARSHAL.
REFUSED = (tc.tv_array, tc.tv_octet, 2**31 - 1)
#: The descriptor of the member that is read next, in a list as `tv__indirect` has it.
chosen: list[Any] = [REFUSED]
#: The member that is read as chosen.
CHOSEN = (tc.tv__indirect, chosen)


def struct_of(make: Callable[..., Any], *members: Any) -> Any:
    """The descriptor of a struct that is made by a function of its members. members: names and descriptors in turn."""
    return tc.tv_struct, make, "IDL:RoboCorba/Bounded:1.0", "Bounded", *members


#: Takes no bytes.
NOTHING = struct_of(lambda: None)
