"""Commands that stop, watch or order robots start at once: they load neither the compiler nor the physics."""

from __future__ import annotations

import subprocess
import sys

#: Modules of such commands, and what they load when they are called.
LIGHT = (
    "commands.robot",
    "corba.remote.emergency_stop",
    "commands.status",
    "commands.watch",
    "commands.mission",
    "commands.program_run",
    "commands.foxglove",
    "commands.ros2",
    "commands.openrtm",
)
#: What takes long to load: half of the time until a robot is ordered to stop.
HEAVY = ("numba", "mujoco", "pymunk", "matplotlib")


def test_commands_load_nothing_heavy() -> None:
    looks = "".join(
        f"import robocorba.{module}\nprint({module!r}, *[name for name in {HEAVY} if name in sys.modules])\n"
        for module in LIGHT
    )
    ran = subprocess.run((sys.executable, "-c", f"import sys\n{looks}"), capture_output=True, text=True, timeout=120)
    assert ran.stdout.splitlines() == list(LIGHT), ran.stderr
