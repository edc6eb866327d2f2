"""Makes the reference of the Python API from docstrings, a part of the site (make_site.py)."""

from __future__ import annotations

import importlib
import warnings
from pathlib import Path

#: Modules for those who write clients, programs, adaptors and cooperative icons in Python; their sub-modules too.
MODULES = (
    "robocorba.system.settings",
    "robocorba.orb.orb",
    "robocorba.events.corba.event_client",
    "robocorba.errors",
    "robocorba.robot.programs",
    "robocorba.robot.adaptor",
    "robocorba.robot.motion.robot_state",
    "robocorba.map_editor.model",
    "robocorba.map_editor.native",
    "robocorba.map_editor.formats",
    "robocorba.map_editor.samples",
    "robocorba.planning.planner",
    "robocorba.planning.request",
    "robocorba.robot.kinematics.inverse",
    "robocorba.missions.cooperative_planner",
    "robocorba.missions.subplan",
    "robocorba.simulation.recording",
)


def make(folder: Path) -> None:
    """Needs the extra `docs`."""
    import pdoc

    # Types of `__init__` that a library has made lose where their names are from; they are shown as written.
    warnings.filterwarnings("ignore", "Error parsing type annotation", module="pdoc")
    for name in MODULES:
        importlib.import_module(name)  # while pdoc imports, processes are forbidden, and a library of mujoco starts one
    pdoc.render.configure(docformat="restructuredtext", footer_text="RoboCorba")
    pdoc.pdoc(*MODULES, output_directory=folder)
