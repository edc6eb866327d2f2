"""Corrections of how omniORBpy reads values of types that the process has no stubs for.

The class for a valuetype is made when the first value arrives. omniORBpy 4.3 has such a function, but it confuses
isinstance with issubclass for a valuetype that derives from another unknown one, and tries to make a class that Python
refuses. Then an assertion of its core fails, and threads of the process hang or spin.

An enumeration may come without a repository id, which CORBA leaves optional in types; Combat, for one, sends none.
omniORBpy knows the empty id as that of CORBA::Object, and reads a reference in place of the enumerator.
"""

from __future__ import annotations

from typing import Any

import omniORB


def unknown_value(repository_id: str, base: Any) -> type:
    """The class for a valuetype. base: a descriptor with the base class at [1]; tv_null, an integer, for none."""
    known = omniORB.UnknownValueBase if base == omniORB.tcInternal.tv_null else base[1]
    bases = (known,) if issubclass(known, omniORB.UnknownValueBase) else (omniORB.UnknownValueBase, known)
    return type("UnknownValue", bases, {"_NP_RepositoryId": repository_id})


def patch_omniorb() -> None:
    """Correct the ORB of this process."""
    omniORB.createUnknownValue = unknown_value
    omniORB.typeMapping.pop("", None)
    omniORB.tcInternal.typeCodeMapping.pop("", None)
