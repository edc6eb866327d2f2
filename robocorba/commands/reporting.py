"""How commands report errors: one line on stderr."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import typer

from robocorba.errors.base import RoboCorbaError
from robocorba.system.printing import line


@contextlib.contextmanager
def reporting(command: str, *errors: type[Exception]) -> Iterator[None]:
    """Print an error of RoboCorba, of CORBA or of the given types as one line, and exit with code 1."""
    from robocorba.orb.calls import CALL_ERRORS, error_of  # loads omniORB, which a help need not

    caught: tuple[type[Exception], ...] = (RoboCorbaError, *CALL_ERRORS, *errors)
    try:
        yield
    except caught as error:
        line(f"robocorba {command}: {error_of(error)}", err=True)
        raise typer.Exit(1) from None
