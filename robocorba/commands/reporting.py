"""How commands tell what went wrong: one line on stderr."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import typer
from omniORB import CORBA

from robocorba.corba.calls import describe
from robocorba.corba.conversion import errors as idl_errors
from robocorba.errors.base import RoboCorbaError


@contextlib.contextmanager
def reporting(command: str) -> Iterator[None]:
    """Errors as one line, with exit code 1."""
    try:
        yield
    except RoboCorbaError as wrong:
        reason = str(wrong)
    except CORBA.UserException as wrong:
        reason = idl_errors.error_of(wrong)
    except CORBA.SystemException as wrong:
        reason = f"the call failed ({describe(wrong)})"
    else:
        return
    typer.echo(f"robocorba {command}: {reason}", err=True)
    raise typer.Exit(1)
