"""Translation of domain errors to IDL exceptions and back.

Each module of this package registers the errors of its subject, so that a process loads only what it translates."""

from __future__ import annotations

import functools
import importlib
import inspect
import logging
from collections.abc import Callable
from typing import Any, NoReturn

from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotBound, NotPermitted, NotReachable, ServiceError

#: Maximum length of each text in an IDL exception [characters]; it may quote input of any length.
MAX_TEXT = 500
#: The modules of robocorba/ that register errors.
SUBJECTS = (
    *("events.corba.events", "map_editor.corba.maps", "missions.corba.missions", "orb.guarded_names"),
    *("planning.corba.paths", "robot.corba.robot_states", "robot.corba.senses", "simulation.corba.scans"),
    *("simulation.corba.sessions", "system.corba.processes"),
)

_log = logging.getLogger(__name__)
_to_idl: dict[type[Exception], Callable[[Any], Exception]] = {}
_to_domain: dict[type[Exception], Callable[[Any], Exception]] = {}


def register(error: type[RoboCorbaError], exception: Any, *fields: str) -> None:
    """Translate `error` to the IDL `exception`, whose members are these fields of the error, and back."""
    members = [name for name in inspect.signature(exception.__init__).parameters if name != "self"]
    register_with(
        error,
        exception,
        lambda e: exception(*(_wire_value(getattr(e, field)) for field in fields)),
        lambda e: error(*(getattr(e, member) for member in members)),
    )


def register_with(
    error: type[RoboCorbaError],
    exception: Any,
    to_idl: Callable[[Any], Exception],
    to_domain: Callable[[Any], Exception] | None = None,
) -> None:
    """Translate with the given functions; without `to_domain`, only to the IDL exception."""
    _to_idl[error] = to_idl
    if to_domain:
        _to_domain[exception] = to_domain


def register_system(error: type[RoboCorbaError], exception: Any) -> None:
    """Translate `error` to a CORBA system exception with completion status COMPLETED_NO."""
    register_with(error, exception, lambda e: exception(0, CORBA.COMPLETED_NO))


def registered() -> set[type[Exception]]:
    """All domain errors that have an IDL exception."""
    _load_all()
    return set(_to_idl)


def raise_idl(error: RoboCorbaError) -> NoReturn:
    """Raise the IDL exception for a domain error; CORBA::INTERNAL if none is registered, which is a defect."""
    if type(error) not in _to_idl:
        _load_all()
    make = _to_idl.get(type(error))
    if make is None:
        _log.error("%s has no IDL exception: %s", type(error).__name__, error)
        raise CORBA.INTERNAL(0, CORBA.COMPLETED_MAYBE) from error
    exception = make(error)
    if isinstance(exception, CORBA.PERSIST_STORE):  # which has no text for the caller
        _log.error("%s", error)
    raise _with_short_texts(exception) from error


def translating(method: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator for methods of servants: raises IDL exceptions for domain errors."""

    @functools.wraps(method)
    def call(*arguments: Any) -> Any:
        try:
            return method(*arguments)
        except RoboCorbaError as error:
            raise_idl(error)

    return call


def forwarded(part: str, method: Callable[..., Any]) -> Callable[..., Any]:
    """An operation that a method of a part of the servant, its attribute, does: as `translating`."""
    name = method.__name__

    def call(servant: Any, *arguments: Any) -> Any:
        return getattr(getattr(servant, part), name)(*arguments)

    return translating(call)


def domain_error(exception: Any) -> Exception | None:
    """The domain error for an IDL exception, None for any other exception."""
    if type(exception) not in _to_domain and isinstance(exception, CORBA.UserException):
        _load_all()
    make = _to_domain.get(type(exception))
    return make(exception) if make else None


def _load_all() -> None:
    for subject in SUBJECTS:
        importlib.import_module(f"robocorba.{subject}")


def _wire_value(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _with_short_texts(exception: Any) -> Any:
    for member, value in vars(exception).items():
        if isinstance(value, str) and len(value) > MAX_TEXT:
            setattr(exception, member, value[:MAX_TEXT])
    return exception


# ServiceError: the store of a server failed, and nothing was changed.
register_system(ServiceError, CORBA.PERSIST_STORE)
# What the servant's process calls itself does not answer now.
register_system(NotReachable, CORBA.TRANSIENT)
register_system(NotBound, CORBA.TRANSIENT)
# Its caller's role does not include an operation, or that of the servant's process does not.
register_system(NotPermitted, CORBA.NO_PERMISSION)
