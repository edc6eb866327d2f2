"""Makes the reference of the Python API from docstrings: python docs/make_api.py [FOLDER], by default docs/api."""

from __future__ import annotations

import importlib
import sys
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


def main(folder: str = str(Path(__file__).parent / "api")) -> None:
    import pdoc  # only with the extra `dev`

    for name in MODULES:
        importlib.import_module(name)  # while pdoc imports, processes are forbidden, and a library of mujoco starts one
    pdoc.render.configure(docformat="restructuredtext", footer_text="RoboCorba")
    pdoc.pdoc(*MODULES, output_directory=Path(folder))
    print(Path(folder) / "index.html")


if __name__ == "__main__":
    main(*sys.argv[1:])
