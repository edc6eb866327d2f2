"""A test that is skipped fails where everything is installed, unless its reason is on the list."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TEST = """
import pytest

def test_lacks_a_program(): pytest.skip("a program is not installed")
def test_lacks_a_privilege(): pytest.skip("needs network namespaces: not permitted")
@pytest.mark.skipif(True, reason="another is not installed")
def test_marked(): pass
@pytest.mark.xfail
def test_expected(): assert False
def test_sound(): pass
"""
MODULE = 'import pytest\npytest.importorskip("no_such_module", reason="a module is not installed")\n'


@pytest.mark.parametrize(("no_skips", "workers"), [("", ()), ("1", ("--numprocesses", "2"))])
def test_unexpected_skips_fail_the_run(tmp_path: Path, no_skips: str, workers: tuple[str, ...]) -> None:
    (tmp_path / "test_some.py").write_text(TEST)
    (tmp_path / "test_module.py").write_text(MODULE)
    environment = {**os.environ, "ROBOCORBA_NO_SKIPS": no_skips, "PYTHONPATH": str(ROOT)}
    command = (
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "tests.skips",
        "-rfEs",
        "--continue-on-collection-errors",
        *workers,
        str(tmp_path),
    )
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    listed = [line for line in ran.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if no_skips:
        assert ran.returncode != 0
        names = ("test_lacks_a_program", "test_marked", "test_module")
        assert len(listed) == len(names) and all(any(name in line for line in listed) for name in names), ran.stdout
    else:
        assert (ran.returncode, listed) == (0, []), ran.stdout
