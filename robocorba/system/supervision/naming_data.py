"""The data file of omniNames, which refuses to start if a line of it is damaged.

    port 2809
    persistent 7670036b0100337f
    create 4e616d6553657276696365
    bind IOR:... NAME KIND ncontext IOR:...

Each line is a change; a kill or a full disk can cut the last one. omninames.bak is an earlier state of the file."""

from __future__ import annotations

import itertools
import logging
import re
from pathlib import Path

from robocorba.errors.services import ServiceError
from robocorba.system.damaged_files import SUFFIX, set_aside

DATA, EARLIER = "omninames.dat", "omninames.bak"
#: Lines that a file begins with.
_HEADER = tuple(map(re.compile, (rb"port \d+", rb"persistent [0-9a-f]+", rb"create [0-9a-f]+")))
#: Each line after these. In names and kinds, white space is escaped.
_CHANGE = re.compile(
    rb"create [0-9a-f]+|destroy IOR:[0-9a-f]+|unbind IOR:[0-9a-f]+ .*"
    rb"|bind IOR:[0-9a-f]+ .* n(object|context) IOR:[0-9a-f]+",
    re.DOTALL,
)
_log = logging.getLogger(__name__)


def mend_naming_data(folder: Path) -> None:
    """Set a damaged data file aside, and keep what precedes the damage, or the earlier state. Servers bind their names
    again; other names are missing if they were bound later. To be called while omniNames does not run. Raises
    ServiceError."""
    file, earlier = folder / DATA, folder / EARLIER
    new = file.with_suffix(".new")
    try:
        new.unlink(missing_ok=True)
        if not file.exists():
            _use_earlier(file, earlier)
            return
        content = file.read_bytes()
        kept = intact_part(content)
        if kept == content:
            return
        former = intact_part(earlier.read_bytes()) if not kept and earlier.exists() else b""
        kept_lines = kept.count(b"\n")
        lines = content.count(b"\n") - kept_lines
        if kept or former:
            _write(new, kept or former)  # first: on a full disk, all stays as it is until there is room
        set_aside(file, f"line {kept_lines + 1}", _consequence(lines, kept, former))
        if earlier.exists():
            earlier.replace(earlier.with_name(earlier.name + SUFFIX))
        if new.exists():
            new.replace(file)
    except OSError as error:
        raise ServiceError(f"can't use {file}: {error.strerror}") from None


def _use_earlier(file: Path, earlier: Path) -> None:
    """omniNames does not start with nothing but the earlier state."""
    if not earlier.exists():
        return
    former = intact_part(earlier.read_bytes())
    if former:
        new = file.with_suffix(".new")
        _write(new, former)
        new.replace(file)
        earlier.unlink()
        _log.warning("%s is missing; an earlier state is used, and servers bind their names again", file)
    else:
        set_aside(earlier, "line 1", "the naming service begins without names; servers bind their names again")


def _write(file: Path, content: bytes) -> None:
    """Raises OSError, and leaves nothing then."""
    try:
        file.write_bytes(content)
    except OSError:
        file.unlink(missing_ok=True)
        raise


def _consequence(lines: int, kept: bytes, former: bytes) -> str:
    if kept:
        return f"its intact beginning is used; {max(lines, 1)} later changes are lost, servers bind their names again"
    if former:
        return "an earlier state is used; servers bind their names again"
    return "the naming service begins without names; servers bind their names again"


def intact_part(content: bytes) -> bytes:
    """The complete lines before the first one that omniNames does not write; empty if it is one of the first three."""
    lines = content.split(b"\n")[:-1]  # what follows the last line break is no complete line
    patterns = itertools.chain(_HEADER, itertools.repeat(_CHANGE))
    intact = list(itertools.takewhile(lambda each: each[1].fullmatch(each[0]), zip(lines, patterns, strict=False)))
    return b"".join(line + b"\n" for line, _ in intact) if len(intact) >= len(_HEADER) else b""
