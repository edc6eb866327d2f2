"""Commands that stop, watch or order robots start at once: they load neither the compiler nor the physics. Robots load
what they need of others' packages."""

from __future__ import annotations

import os
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


def test_kernels_load_no_scipy_and_kinematics_no_opengl() -> None:
    script = """
import os, sys
from robocorba.kinematics.inverse import InverseKinematics
InverseKinematics()
print([name for name in ("scipy.linalg", "glfw", "OpenGL") if name in sys.modules], "MUJOCO_GL" in os.environ)
import numba, numpy
print(numba.njit(lambda a: numpy.dot(a, a))(numpy.eye(2)).tolist())
"""
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    ran = subprocess.run((sys.executable, "-c", script), capture_output=True, text=True, timeout=120, env=environment)
    assert ran.stdout.splitlines() == ["[] False", "[[1.0, 0.0], [0.0, 1.0]]"], ran.stderr
