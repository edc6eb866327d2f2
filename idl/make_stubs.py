"""Make the Python stubs of every IDL file beside this one: python make_stubs.py FOLDER.

FOLDER becomes the package robocorba.stubs; what was in it goes. Uses the omniidl
of the running interpreter where it has one, else the one on PATH.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

HERE = Path(__file__).resolve().parent
#: Modules of the OMG whose stubs come with omniORBpy.
OMG = ("CosEventComm", "CosEventChannelAdmin")


def make_stubs(folder: Path, idl: Path = HERE) -> None:
    """Generate the package `folder` from the IDL files in `idl`. Raises as `omniidl` does."""
    package = "robocorba.stubs"
    fresh = folder.with_name(f".{folder.name}.new")
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir(parents=True)
    files = sorted(str(file) for file in idl.glob("*.idl") if not file.name.startswith("Cos"))
    options = ["-bpython", "-C", str(fresh), f"-Wbpackage={package}", *(f"-Wbextern={module}" for module in OMG)]
    omniidl(*options, *files)
    made = fresh / Path(*package.split("."))
    shutil.rmtree(folder, ignore_errors=True)
    made.rename(folder)
    shutil.rmtree(fresh)
    (folder / "__init__.py").write_text('"""Generated from idl/ by omniidl; do not edit."""\n')


def omniidl(*arguments: str) -> None:
    """Run it. Raises SystemExit with one line where there is none, CalledProcessError where it fails."""
    if importlib.util.find_spec("omniidl"):
        program = [sys.executable, "-c", "from omniidl.main import main; main()"]
    elif shutil.which("omniidl"):
        program = ["omniidl"]
    else:
        raise SystemExit("omniidl is missing: install jeteve-omniorb, or omniORBpy 4.2 or later with its omniidl")
    # It looks for its preprocessor on PATH, where that of a virtual environment is not.
    path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ.get("PATH", os.defpath)])
    subprocess.run([*program, *arguments], check=True, env=os.environ | {"PATH": path})


if __name__ == "__main__":
    make_stubs(Path(sys.argv[1]).resolve())
