"""Conversion of the names of a guarded system from and to the IDL."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robocorba.errors.services import InvalidBinding, NameHeld
from robocorba.orb.exceptions import register
from robocorba.stubs import RoboCorba
from robocorba.system.roles import Role

_ROLES = {role: getattr(RoboCorba, f"{role.name}_ROLE") for role in Role}
_ROLE_OF = {struct: role for role, struct in _ROLES.items()}


def role_references(references: Mapping[Role, Any]) -> list[Any]:
    return [RoboCorba.RoleReference(_ROLES[role], reference) for role, reference in references.items()]


def role_references_of(structs: Any) -> dict[Role, Any]:
    return {_ROLE_OF[struct.whose]: struct.theirs for struct in structs if struct.theirs is not None}


register(NameHeld, RoboCorba.NameHeld, "name")
register(InvalidBinding, RoboCorba.InvalidBinding, "name", "reason")
