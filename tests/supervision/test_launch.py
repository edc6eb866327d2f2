"""Child processes: their lines, their cores, and their end."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from robocorba.supervision.launch import LoggedProcess
from robocorba.testing.processes import eventually, is_running

ECHO = "import sys\nfor line in sys.stdin: print(line, end='', flush=True)"
STUBBORN = (
    "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nprint('ready', flush=True)\ntime.sleep(60)"
)
PARENT = """
import sys
from pathlib import Path
from robocorba.supervision.launch import LoggedProcess
child = LoggedProcess(Path(sys.argv[1]), "sleep", "60")
print(child.pid, flush=True)
sys.stdin.read()
"""


def test_lines(tmp_path: Path) -> None:
    with LoggedProcess(tmp_path / "log", sys.executable, "-c", ECHO, stdin=subprocess.PIPE) as child:
        child.write_line("one")
        assert child.read_line(60.0) == "one\n"
        with pytest.raises(TimeoutError):
            child.read_line(0.01)
        psutil.Process(child.pid).kill()
        assert child.read_line(60.0) == child.read_line(60.0) == ""
    assert not child.is_running


def test_output_that_cannot_be_read_is_the_end_of_the_process(tmp_path: Path) -> None:
    """Its readers would wait for lines that never come."""
    code = "import sys, time; sys.stdout.buffer.write(b'\\xff\\n'); sys.stdout.flush(); time.sleep(60)"
    with LoggedProcess(tmp_path / "log", sys.executable, "-c", code) as child:
        assert child.read_line(60.0) == ""


def test_environment_folder_cores_and_log(tmp_path: Path) -> None:
    code = "import os, sys; print(os.sched_getaffinity(0), os.getcwd(), dict(os.environ)); sys.exit('out of order')"
    core = max(os.sched_getaffinity(0))
    command = (sys.executable, "-c", code)
    with LoggedProcess(tmp_path / "log", *command, cwd=tmp_path, env={"A": "b"}, cores=(core,)) as child:
        printed = child.read_line(60.0)
    assert printed.startswith(f"{{{core}}} {tmp_path} ")
    assert "'A': 'b'" in printed
    assert "PATH" not in printed
    assert child.log_tail(6) == "order\n"


def test_a_child_that_ignores_sigterm_is_killed(tmp_path: Path) -> None:
    with LoggedProcess(tmp_path / "log", sys.executable, "-c", STUBBORN, grace_period_s=0.2) as child:
        assert child.read_line(60.0) == "ready\n"
    assert not child.is_running


def test_a_child_ends_with_its_parent(tmp_path: Path) -> None:
    command = [sys.executable, "-c", PARENT, str(tmp_path / "log")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        assert is_running(child)
        parent.kill()
    eventually(lambda: not is_running(child))
