"""Folders in which nobody else can read or replace anything: the state folder, and that of compiled kernels."""

from __future__ import annotations

import contextlib
import grp
import logging
import os
import pwd
import stat
from collections.abc import Iterator
from pathlib import Path

from robocorba.errors.services import ServiceError

#: Rights of a private folder and of what is created in it.
FOLDER_MODE, UMASK = 0o700, 0o077
#: Rights of group and others.
_OTHERS = stat.S_IRWXG | stat.S_IRWXO

_log = logging.getLogger(__name__)


def claim_state(folder: Path) -> None:
    """Create the state folder for this user alone, or remove the rights of others; from now on, this process creates
    files for this user alone.

    A folder that also serves for something else keeps its mode, but not the files of RoboCorba in it. Raises
    ServiceError if others own the folder or can write to it."""
    os.umask(UMASK)
    try:
        folder.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
        found = folder.stat()
        if found.st_uid not in _trusted() and os.geteuid() != 0:
            raise ServiceError(f"the state folder {folder} belongs to {_user(found.st_uid)}; choose another --state")
        if found.st_mode & _OTHERS and _is_for_state(folder, found):
            folder.chmod(FOLDER_MODE)
            _log.warning("the state folder %s was open to other users; now it has mode 0700", folder)
        elif is_writable_by_others(found):
            raise ServiceError(f"others can write to the state folder {folder}; choose a folder of its own for --state")
        for part in _parts(folder):
            with contextlib.suppress(FileNotFoundError):  # another process may replace it
                mode = part.lstat().st_mode
                if mode & _OTHERS and not stat.S_ISLNK(mode):
                    part.chmod(stat.S_IMODE(mode) & ~_OTHERS)
    except OSError as error:
        raise ServiceError(f"can't use the state folder {folder}: {error.strerror}") from None


def make_folder(folder: Path) -> None:
    """Create a private folder, and those above it that are missing. Raises OSError."""
    for place in reversed((folder, *folder.parents)):
        with contextlib.suppress(FileExistsError):
            place.mkdir(mode=FOLDER_MODE)


def exposure(folder: Path) -> str:
    """Why others could replace what is in a folder, such as "others can write to /srv"; empty if nobody can.

    Looks at the folders above it, too. Raises OSError."""
    here = folder.resolve(strict=True)
    for place in (here, *here.parents):
        found = place.stat()
        if found.st_uid not in _trusted():
            return f"{place} belongs to {_user(found.st_uid)}"
        # In a folder with the sticky bit, such as /tmp, others can't replace what they don't own.
        if is_writable_by_others(found) and (place == here or not found.st_mode & stat.S_ISVTX):
            return f"others can write to {place}"
    return ""


def is_writable_by_others(found: os.stat_result) -> bool:
    """Whether users other than the owner can write. A group of this user alone, as many systems make, is no other."""
    if found.st_mode & stat.S_IWOTH:
        return True
    return bool(found.st_mode & stat.S_IWGRP) and not _is_own_group(found.st_gid)


def _is_own_group(group: int) -> bool:
    try:
        user = pwd.getpwuid(os.geteuid())
        return group == user.pw_gid and not set(grp.getgrgid(group).gr_mem) - {user.pw_name}
    except KeyError:
        return False


def _is_for_state(folder: Path, found: os.stat_result) -> bool:
    """Whether a folder is there for the state alone: neither /tmp nor the user's home, whatever --state says."""
    if found.st_mode & stat.S_ISVTX or folder.resolve() in (Path.home(), Path("/")):
        return False
    names = {entry.name for entry in os.scandir(folder)}
    return not names or not names.isdisjoint(("lock", "logs"))


def _parts(folder: Path) -> Iterator[Path]:
    """Parts of a state folder that may have been created with other rights by earlier releases, or copied."""
    for pattern in ("lock", "logs", "omninames", "channels", "missions", "*.json", "*.ior", "*.sqlite*", "*.new"):
        yield from folder.glob(pattern)


def _trusted() -> tuple[int, int]:
    return 0, os.geteuid()


def _user(number: int) -> str:
    try:
        return f"user {pwd.getpwuid(number).pw_name}"
    except KeyError:
        return f"user {number}"
