"""Clients that were compiled with the IDL of a release, against the servers of today."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from robocorba import __version__
from robocorba.testing.processes import Running, read_json

pytestmark = [pytest.mark.system, pytest.mark.full]

ROOT = Path(__file__).resolve().parents[2]
RELEASED = ROOT / "idl" / "released"
CLIENT = Path(__file__).with_name("released_client.py")


def compiled(release: str, folder: Path) -> Path:
    """Python stubs of a release's IDL, as a client's own project would make them."""
    make = [sys.executable, str(ROOT / "idl" / "make_stubs.py"), str(folder), str(RELEASED / release)]
    subprocess.run(make, check=True, timeout=60)
    return folder


@pytest.mark.parametrize("release", [folder.name for folder in sorted(RELEASED.iterdir())])
def test_a_client_of_a_release_works_unchanged(system: Running, tmp_path: Path, release: str) -> None:
    stubs = compiled(release, tmp_path / "stubs")
    command = (sys.executable, str(CLIENT), str(system.naming))
    environment = {**os.environ, "PYTHONPATH": str(stubs)}
    ran = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert (ran.returncode, ran.stderr) == (0, "")
    found: dict[str, Any] = read_json(ran.stdout)
    path = found.pop("path")
    assert (path[0], path[-1]) == ("START", "GOAL") and "ELEVATOR_ENTRY" in path
    assert found == {
        "paths": 1,
        "refused": ["goal", "L9", ["L1", "L2"]],
        "edited": True,
        "rays": 181,
        "bodies": ["released"],
        "since": True,
        "event": "released.client",
        "missions": 0,
        "release": __version__,
    }
