"""Files of the state folder that can't be read: what can be made again is set aside, what can't needs a backup."""

from __future__ import annotations

import contextlib
import logging
import shlex
import shutil
from datetime import datetime
from pathlib import Path

import msgspec

from robocorba.system.decoding import decode_json

#: What the name of a file that was set aside ends with.
SUFFIX = ".damaged"
#: File in the state folder that names the last backup.
LAST_BACKUP = "backup.json"

_log = logging.getLogger(__name__)


class BackupNote(msgspec.Struct):
    """The content of backup.json. file: of the last backup, absolute. made: POSIX time [s]."""

    file: str
    made: float


def set_aside(file: Path, reason: str, consequence: str, copy: bool = False) -> None:
    """Rename a damaged file, or copy it, to FILE.damaged, in place of an earlier one, and log a warning.

    consequence: what is done without it. Raises OSError."""
    aside = file.with_name(file.name + SUFFIX)
    if copy:
        shutil.copyfile(file, aside)
    else:
        file.replace(aside)
    _log.warning("%s is damaged (%s); it is kept as %s, and %s", file, reason, aside.name, consequence)


def restore_advice(file: Path) -> str:
    """What to do about a damaged file, in a state folder or a folder in it: how to restore the last backup, if any."""
    for state in file.absolute().parents[:2]:
        with contextlib.suppress(OSError, msgspec.MsgspecError, ValueError, OverflowError):
            note = decode_json((state / LAST_BACKUP).read_bytes(), BackupNote)
            made = datetime.fromtimestamp(note.made).astimezone().isoformat(sep=" ", timespec="seconds")
            if Path(note.file).is_file():
                command = shlex.join(("robocorba", "restore", note.file, "--state", str(state)))
                return f"restore the backup of {made} with: {command}"
            return f"the last backup, of {made}, is no longer at {note.file}; from a copy: robocorba restore FILE"
    return (
        "no backup is known here; with one: robocorba restore FILE; else move it to another folder to begin without it"
    )
