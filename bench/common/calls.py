"""CORBA calls whose exceptions can be pickled and read."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from omniORB import CORBA

from robocorba.corba.calls import describe
from robocorba.corba.conversion import errors as idl_errors

T = TypeVar("T")


class LoggedOff(RuntimeError):
    """The object of a call, such as a robot's session, has ended."""


def checked_call(call: Callable[..., T], *arguments: object) -> T:
    """Make a call, and convert CORBA exceptions to RuntimeError with a description."""
    try:
        return call(*arguments)
    except CORBA.UserException as error:
        raise RuntimeError(idl_errors.error_of(error)) from None
    except CORBA.OBJECT_NOT_EXIST as error:
        raise LoggedOff(describe(error)) from None
    except CORBA.SystemException as error:
        raise RuntimeError(describe(error)) from None
