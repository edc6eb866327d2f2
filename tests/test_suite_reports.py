"""What a run of the suite reports: how a failed test is run alone, its logs, and skips that are not allowed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.system, pytest.mark.full]

ROOT = Path(__file__).resolve().parents[1]
TEST = """
import pytest

def test_fails(tmp_path):
    (tmp_path / "server.log").write_text("\\n".join(f"line {number}." for number in range(100)))
    assert False
def test_lacks_a_program(): pytest.skip("a program is not installed")
def test_lacks_a_privilege(): pytest.skip("needs network namespaces: not permitted")
@pytest.mark.skipif(True, reason="another is not installed")
def test_marked(): pass
@pytest.mark.xfail
def test_expected(): assert False
def test_passes(tmp_path):
    (tmp_path / "other.log").write_text("of a test that passes")
"""
MODULE = 'import pytest\npytest.importorskip("no_such_module", reason="a module is not installed")\n'


@pytest.mark.parametrize(("no_skips", "workers"), [("", "-q"), ("1", "--numprocesses=1")])
def test_failures_are_explained_and_unexpected_skips_fail_the_run(tmp_path: Path, no_skips: str, workers: str) -> None:
    (tmp_path / "test_some.py").write_text(TEST)
    (tmp_path / "test_module.py").write_text(MODULE)
    environment = {**os.environ, "ROBOCORBA_NO_SKIPS": no_skips, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "pytest", "-p", "tests.failures", "-p", "tests.skips", "--basetemp", "base"]
    command += ["-rfEs", "--continue-on-collection-errors", workers, "."]
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    lines = ran.stdout.splitlines()
    listed = {line.split(" - ")[0] for line in lines if line.startswith(("FAILED", "ERROR test"))}
    expected = {"FAILED test_some.py::test_fails"}
    if no_skips:
        expected |= {"FAILED test_some.py::test_lacks_a_program", "ERROR test_some.py::test_marked"}
        expected.add("ERROR test_module.py")
    assert listed == expected, ran.stdout
    assert "python -m pytest test_some.py::test_fails" in lines, ran.stdout
    (start,) = (i for i, line in enumerate(lines) if line.startswith("--- ") and line.endswith("/server.log"))
    assert lines[start + 1 : start + 13] == [f"line {number}." for number in range(88, 100)]
    assert "of a test that passes" not in ran.stdout
