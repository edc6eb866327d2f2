"""Make the Python stubs of every IDL file beside this one and in openrtm/: python make_stubs.py FOLDER.

FOLDER becomes the package robocorba.stubs; what was in it goes. Uses the omniidl
of the running interpreter where it has one, else the one on PATH.

With the folder of other IDL files, such as those of a release, the stubs are modules
in FOLDER, as in the project of a client: python make_stubs.py FOLDER IDL_FOLDER.
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


def make_stubs(folder: Path) -> None:
    """Generate the package `folder` from our IDL files. Raises as `omniidl` does."""
    package = "robocorba.stubs"
    fresh = folder.with_name(f".{folder.name}.new")
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir(parents=True)
    for idl in (HERE, HERE / "openrtm"):
        generate(fresh, idl, f"-Wbpackage={package}")
    made = fresh / Path(*package.split("."))
    shutil.rmtree(folder, ignore_errors=True)
    made.rename(folder)
    shutil.rmtree(fresh)
    (folder / "__init__.py").write_text('"""Generated from idl/ by omniidl; do not edit."""\n')


def generate(folder: Path, idl: Path, *options: str) -> None:
    """Generate modules in `folder` from the IDL files in `idl`. Raises as `omniidl` does."""
    omniidl("-bpython", "-C", str(folder), *options, *(f"-Wbextern={module}" for module in OMG), *idl_files(idl))


def idl_files(folder: Path) -> list[str]:
    """The IDL files in a folder that are ours."""
    return sorted(str(file) for file in folder.glob("*.idl") if not file.name.startswith("Cos"))


def omniidl(*arguments: str) -> str:
    """Run it; returns what it prints. Raises SystemExit with one line where there is none, CalledProcessError where it
    fails."""
    if importlib.util.find_spec("omniidl"):
        program = [sys.executable, "-c", "from omniidl.main import main; main()"]
    elif shutil.which("omniidl"):
        program = ["omniidl"]
    else:
        raise SystemExit("omniidl is missing: install jeteve-omniorb, or omniORBpy 4.2 or later with its omniidl")
    # It looks for its preprocessor on PATH, where that of a virtual environment is not.
    path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ.get("PATH", os.defpath)])
    ran = subprocess.run(
        [*program, *arguments], check=True, env=os.environ | {"PATH": path}, stdout=subprocess.PIPE, text=True
    )
    return ran.stdout


if __name__ == "__main__":
    target, *of = (Path(argument).resolve() for argument in sys.argv[1:])
    if of:
        target.mkdir(parents=True, exist_ok=True)
        generate(target, of[0])
    else:
        make_stubs(target)
