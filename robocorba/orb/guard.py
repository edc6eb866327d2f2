"""Guarded objects: what a process of a guarded system activates instead of its servants.

A named object has a reference for each role. That of observers has the object's name as its key, so everybody can make
it; the others have keys that can't be guessed. The object behind each refuses the operations that
`robocorba.system.roles` does not give to the role, with NO_PERMISSION. What is allowed is the servant's own method: a
guard costs a call nothing.
"""

from __future__ import annotations

import functools
import hashlib
import hmac
import re
import secrets
from collections.abc import Callable
from typing import Any, NoReturn

from omniORB import CORBA

from robocorba.orb.workarounds import operations_of
from robocorba.system.names import ACCESS
from robocorba.system.roles import Role, may_call, may_name


class Guard:
    """The keys of a process's objects, and what stands before its servants.

    secret: from which keys are derived; the same secret gives the same keys, so that references stay valid."""

    def __init__(self, secret: bytes = b"") -> None:
        self._secret = secret or secrets.token_bytes(32)

    def key(self, name: str, role: Role = Role.SERVER) -> str:
        """The object key for a role; that for servers is also the key of objects without roles."""
        if role is Role.OBSERVER:
            return name
        return f"{name}~{self._digest(f'key {role.name} {name}')}"

    def keys(self, name: str) -> list[str]:
        """Those of all roles."""
        return [self.key(name, role) for role in Role]

    def robot_key(self, name: str, robot: str) -> str:
        """The object key for a robot with a file of its own; robot: the key of its naming context."""
        return f"{name}~{self._digest(f'robot {robot} {name}')}"

    def proof(self, name: str) -> str:
        """The secret by which this process holds a name."""
        return self._digest(f"name {name}")

    def _digest(self, text: str) -> str:
        return hmac.new(self._secret, text.encode(), hashlib.sha256).hexdigest()


def guarded(servant: Any, role: Role) -> Any:
    """A servant of the same interface that passes on what the role may call."""
    if role is Role.SERVER:
        return servant
    skeleton = servant._omni_skeleton
    interface = interface_of(skeleton)
    guard = _guard_class(skeleton)()
    for operation in operations_of(skeleton):
        if not may_call(role, interface, operation):
            setattr(guard, operation, _refuse)
        elif hasattr(servant, operation):
            method = getattr(servant, operation)
            setattr(guard, operation, method if may_name(role, interface, operation) else _without_name(method))
    return guard


def guarded_for(servant: Any, robot: str) -> Any:
    """The same for one robot: a servant may limit what the role may call to what concerns that robot, by a method
    `bound_to` that returns what stands in place of its operations."""
    guard = guarded(servant, Role.ROBOT)
    for operation, method in servant.bound_to(robot).items() if hasattr(servant, "bound_to") else ():
        setattr(guard, operation, method)
    return guard


def without_keys(uri: str) -> str:
    """A URI for display, without the key of a role that it may contain."""
    return re.sub(rf"({ACCESS}/[a-z]+/)[0-9A-Fa-f]+", r"\1...", uri)


def interface_of(skeleton: Any) -> str:
    """The name of a skeleton's interface without module, such as MapEditor."""
    return str(skeleton._NP_RepositoryId).split(":")[1].rpartition("/")[2]


@functools.cache
def _guard_class(skeleton: Any) -> Any:
    return type(f"Guarded{skeleton.__name__}", (skeleton,), {})


def _refuse(*arguments: Any) -> NoReturn:
    raise CORBA.NO_PERMISSION(0, CORBA.COMPLETED_NO)


def _without_name(method: Callable[..., Any]) -> Callable[..., Any]:
    def call(name: str, *arguments: Any) -> Any:
        if name:
            _refuse()
        return method(name, *arguments)

    return call
