"""What a failed test leaves in its report."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TEST = """
def test_fails(tmp_path):
    (tmp_path / "server.log").write_text("\\n".join(f"line {number}." for number in range(100)))
    assert False
def test_passes(tmp_path):
    (tmp_path / "other.log").write_text("of a test that passes")
"""


def test_a_failure_says_how_it_is_run_alone_and_quotes_its_logs(tmp_path: Path) -> None:
    (tmp_path / "test_some.py").write_text(TEST)
    command = (sys.executable, "-m", "pytest", "-p", "tests.failures", "--basetemp", str(tmp_path / "base"), ".")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    lines = ran.stdout.splitlines()
    assert "python -m pytest test_some.py::test_fails" in lines, ran.stdout
    start = lines.index(f"--- {tmp_path / 'base' / 'test_fails0' / 'server.log'}")
    assert lines[start + 1 : start + 13] == [f"line {number}." for number in range(88, 100)]
    assert "of a test that passes" not in ran.stdout
