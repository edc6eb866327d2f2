"""How commands report errors: one line on stderr."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import typer
from omniORB import CORBA

from robocorba.corba.calls import describe
from robocorba.corba.conversion import errors as idl_errors
from robocorba.errors.base import RoboCorbaError


@contextlib.contextmanager
def reporting(command: str, *errors: type[Exception]) -> Iterator[None]:
    """Print an error of RoboCorba, of CORBA or of the given types as one line, and exit with code 1."""
    caught: tuple[type[Exception], ...] = (RoboCorbaError, *errors)
    try:
        yield
    except caught as error:
        reason = str(error)
    except CORBA.UserException as error:
        reason = idl_errors.error_of(error)
    except CORBA.SystemException as error:
        reason = f"the call failed ({describe(error)})"
    else:
        return
    typer.echo(f"robocorba {command}: {reason}", err=True)
    raise typer.Exit(1)
