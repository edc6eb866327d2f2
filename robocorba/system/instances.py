"""Instances: several systems of one user, each with a state folder and a naming service's port of its own."""

from __future__ import annotations

import json
from pathlib import Path

import platformdirs

from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.decoding import read_text
from robocorba.system.names import PORTS


def instance_folder(name: str) -> Path:
    """The state folder of an instance; for an empty name that of the system that is none."""
    return Path(platformdirs.user_state_dir(f"robocorba-{name}" if name else "robocorba", False))


def instance_folders() -> dict[str, Path]:
    """The state folders of this user's instances by name."""
    parent = instance_folder("").parent
    return {path.name.removeprefix("robocorba-"): path for path in sorted(parent.glob("robocorba-*"))}


def port_to_start(folder: Path) -> str:
    """The port for the naming service of an instance that starts: its former one, else a free one. Raises
    StartFailed."""
    if former := json_member(folder / PORTS, "naming"):
        return former
    with claimed_ports() as port:
        return str(port)


def json_member(file: Path, name: str) -> str:
    """A member of a JSON file in a state folder; empty if it is missing."""
    try:
        return str(json.loads(read_text(file))[name])
    except (OSError, ValueError, LookupError, TypeError):
        return ""
