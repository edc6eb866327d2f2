"""The parts of omniORBpy that only robocorba/orb/workarounds.py may use are there, and its faults are not cured yet."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import omniORB

from robocorba.orb import workarounds

PACKAGE = Path(workarounds.__file__).parents[1]
PRIVATE = r"tcInternal|typeMapping|typeCodeMapping|objrefMapping|createUnknownValue|_omni_op_d|\._obj\b|mallopt"

#: Whether omniORBpy by itself takes the empty id for that of CORBA::Object, and has its own class of unknown values.
FAULTS = """
import omniORB
print("" in omniORB.typeMapping, "" in omniORB.tcInternal.typeCodeMapping, omniORB.createUnknownValue.__module__)
"""


def test_private_parts_are_used_in_one_file() -> None:
    files = [file for file in PACKAGE.rglob("*.py") if "stubs" not in file.parts and file.name != "workarounds.py"]
    used = {str(file.relative_to(PACKAGE)): re.findall(PRIVATE, file.read_text()) for file in files}
    assert {file: found for file, found in used.items() if found and file != "orb/bounded_any.py"} == {}
    assert set(used["orb/bounded_any.py"]) == {"tcInternal"}  # in its docstring


def test_the_faults_are_there() -> None:
    """Where this fails, the correction is of no use any more."""
    found = subprocess.run([sys.executable, "-c", FAULTS], capture_output=True, text=True, check=True)
    assert found.stdout == "True True omniORB\n"
    assert omniORB.createUnknownValue is workarounds.unknown_value
    assert "" not in omniORB.typeMapping
