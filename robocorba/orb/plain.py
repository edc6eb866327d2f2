"""IDL values as JSON types."""

from __future__ import annotations

from typing import Any

import omniORB


def plain(value: Any) -> Any:
    """A value with the member names of the IDL: structs as dicts, enumerators as their names, sequences as lists."""
    if isinstance(value, omniORB.EnumItem):
        return value._n
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if hasattr(value, "_NP_RepositoryId"):
        return {member: plain(entry) for member, entry in vars(value).items()}
    return value
