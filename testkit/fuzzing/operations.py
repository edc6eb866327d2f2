"""The interfaces and operations of the IDL, as the stubs describe them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import CosEventChannelAdmin
import CosEventComm

from robocorba.stubs import RoboCorba, YeRTUnitMobility, _GlobalIDL

MODULES = (RoboCorba, YeRTUnitMobility, _GlobalIDL, CosEventChannelAdmin, CosEventComm)


class Operation(NamedTuple):
    """An operation, or the reading of an attribute. wanted, returned: descriptors of arguments and results; a oneway
    operation returns None. raised: its exceptions, by repository id."""

    name: str
    wanted: tuple[Any, ...]
    returned: tuple[Any, ...] | None
    raised: dict[str, Any] | None

    @property
    def descriptor(self) -> tuple[Any, ...]:
        return self.wanted, self.returned, self.raised


def interfaces() -> Iterator[Any]:
    """Every interface of the IDL."""
    for module in MODULES:
        for name in sorted(vars(module)):
            if name.startswith("_objref_"):
                yield getattr(module, name.removeprefix("_objref_"))


def operations(interface: Any) -> list[Operation]:
    """The operations of an interface, with those that it inherits."""
    found = {name: getattr(interface, name) for name in sorted(dir(interface)) if name.startswith("_d_")}
    # Types that are defined within the interface are described by such attributes as well.
    return [Operation(name[3:], *each[:3]) for name, each in found.items() if isinstance(each[0], tuple)]
