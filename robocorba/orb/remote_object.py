"""An object in another process: resolved when it is first needed, called with a timeout, its exceptions translated."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotPermitted, NotReachable
from robocorba.orb.calls import describe
from robocorba.orb.exceptions import domain_error
from robocorba.orb.orb import Orb
from robocorba.system.decoding import read_text

Answer = TypeVar("Answer")


@contextlib.contextmanager
def translated(what: str, failure: type[RoboCorbaError] = NotReachable) -> Iterator[None]:
    """Calls inside raise domain errors for IDL exceptions, and `failure` if `what` does not answer."""
    try:
        yield
    except CORBA.UserException as error:
        raise (domain_error(error) or error) from None
    except CORBA.NO_PERMISSION:
        refused = NotPermitted(what)
        raise (refused if isinstance(refused, failure) else failure(str(refused))) from None
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
            reference = self._reference = self._resolve()
        try:
            with translated(self._what):
                return operation(reference)
        except NotReachable:
            self._reference = None
            raise

    def _resolve(self) -> Any:
        return self._orb.resolve(self._name, self._interface, self.resolve_timeout_s, self._call_timeout_s)


class FileObject(RemoteObject):
    """The object whose reference is in a file. The file is read at the first call, and again after one that the object
    did not answer. Thread-safe."""

    def __init__(self, orb: Orb, file: Path, interface: Any, what: str, call_timeout_s: float) -> None:
        super().__init__(orb, file.name, interface, what, 0.0, call_timeout_s)
        self._file = file

    def _resolve(self) -> Any:
        try:
            uri = read_text(self._file).strip()
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", "") or "not a reference"
            raise NotReachable(f"{self._what} is not reachable: {self._file}: {reason}") from None
        return self._orb.reference(uri, self._interface, self._call_timeout_s)
