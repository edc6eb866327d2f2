"""What a program was checked against, as a text that travels with it."""

from __future__ import annotations

import hashlib
import re
from typing import NamedTuple

from robocorba.errors.robots import FingerprintMismatch
from robocorba.robot.kinematics.urdf import urdf
from robocorba.robot.programs.program import Program, dumps


class Fingerprint(NamedTuple):
    """program: digest of its icons, however its file is written. robot: digest of the robot's model. map: name and
    version of the building."""

    program: str
    robot: str
    map: str

    def __str__(self) -> str:
        return f"program {self.program} robot {self.robot} map {self.map}"

    def require(self, checked: str) -> None:
        """Raise FingerprintMismatch unless the text `checked` is that of an equal fingerprint."""
        found = re.fullmatch(r"program (\w+) robot (\w+) map (.+)", checked, re.DOTALL)
        if not found:
            raise FingerprintMismatch("fingerprint", repr(checked[:80]), str(self))
        for part, theirs, ours in zip(self._fields, found.groups(), self, strict=True):
            if theirs != ours:
                raise FingerprintMismatch(part, theirs[:200], ours)


def fingerprint(program: Program, building: str, version: int) -> Fingerprint:
    """What a program is checked against on a version of a building."""
    return Fingerprint(_digest(dumps(program)), _digest(urdf()), f"{building} version {version}")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
