"""Values of types without stubs: their classes, made when the first one comes.

omniORBpy 4.3 has such a function, but for a valuetype that is derived from another unknown one it asks isinstance
where issubclass is meant, and makes a class that Python refuses. Its core then fails an assertion, and threads of the
process hang or spin.
"""

from __future__ import annotations

from typing import Any

import omniORB


def unknown_value(repository_id: str, base: Any) -> type:
    """The class for a valuetype. base: a descriptor with the base's class at [1]; tv_null, an integer, for none."""
    known = omniORB.UnknownValueBase if base == omniORB.tcInternal.tv_null else base[1]
    bases = (known,) if issubclass(known, omniORB.UnknownValueBase) else (omniORB.UnknownValueBase, known)
    return type("UnknownValue", bases, {"_NP_RepositoryId": repository_id})


def mend() -> None:
    """Let the ORB of this process use it."""
    omniORB.createUnknownValue = unknown_value
