"""An object in another process: resolved when it is first needed, called with a timeout, its exceptions translated."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from omniORB import CORBA

from robocorba.corba.calls import describe
from robocorba.corba.conversion.errors import domain_error
from robocorba.corba.orb import Orb
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable

Answer = TypeVar("Answer")


@contextlib.contextmanager
def translated(what: str, failure: type[RoboCorbaError] = NotReachable) -> Iterator[None]:
    """Calls inside raise domain errors for IDL exceptions, and `failure` if `what` does not answer."""
    try:
        yield
    except CORBA.UserException as error:
        raise (domain_error(error) or error) from None
    except CORBA.SystemException as error:
        raise failure(f"{what} does not answer ({describe(error)})") from None


class RemoteObject:
    """The object bound to `name`. Resolved at the first call, and again after one that it did not answer. Thread-safe.

    what: its name in messages. Timeouts to resolve it and of each call [s]."""

    def __init__(
        self, orb: Orb, name: str, interface: Any, what: str, resolve_timeout_s: float, call_timeout_s: float
    ) -> None:
        self._orb, self._name, self._interface, self._what = orb, name, interface, what
        self.resolve_timeout_s, self._call_timeout_s = resolve_timeout_s, call_timeout_s
        self._reference: Any = None

    def call(self, operation: Callable[[Any], Answer]) -> Answer:
        """The answer of `operation` for the reference. Raises NotReachable, and the domain errors of IDL exceptions."""
        reference = self._reference
        if reference is None:
            timeouts = self.resolve_timeout_s, self._call_timeout_s
            reference = self._reference = self._orb.resolve(self._name, self._interface, *timeouts)
        try:
            with translated(self._what):
                return operation(reference)
        except NotReachable:
            self._reference = None
            raise
