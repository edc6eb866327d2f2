"""Only what setup.cfg can't say: the stubs are made before anything is packed, and the IDL travels in the package."""

import shutil
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT / "idl"))
from make_stubs import make_stubs  # noqa: E402


class BuildWithIdl(build_py):
    """build_py that adds idl/ to the package."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            target = Path(self.build_lib) / "robocorba" / "idl"
            for file in (*(ROOT / "idl").glob("*.idl"), *(ROOT / "idl" / "openrtm").glob("*.idl")):
                copy = target / file.relative_to(ROOT / "idl")
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(file, copy)


make_stubs(ROOT / "robocorba" / "stubs")
setup(cmdclass={"build_py": BuildWithIdl})
