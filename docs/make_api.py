"""Makes the reference of the Python API from docstrings: python docs/make_api.py [FOLDER], by default docs/api."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

#: Modules for those who write clients, programs, adaptors and cooperative icons in Python; their sub-modules too.
MODULES = (
    "robocorba.settings",
    "robocorba.corba.orb",
    "robocorba.corba.event_client",
    "robocorba.errors",
    "robocorba.programs",
    "robocorba.control.adaptor",
    "robocorba.motion.robot_state",
    "robocorba.maps.model",
    "robocorba.maps.native",
    "robocorba.maps.formats",
    "robocorba.maps.samples",
    "robocorba.planning.planner",
    "robocorba.planning.request",
    "robocorba.kinematics.inverse",
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
