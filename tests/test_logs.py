"""Log files keep one event to a line, whatever the message is."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba import logs
from robocorba.errors.services import ServiceError


def run(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    """`code` in a process that logs to folder/test.log; logging belongs to a process as a whole."""
    begin = f"import logging; from pathlib import Path; from robocorba import logs; folder = Path({str(folder)!r})"
    return subprocess.run(
        [sys.executable, "-c", f"{begin}\nlogs.setup('test', folder)\n{code}"],
        capture_output=True,
        text=True,
        timeout=30,
    )


@given(st.text())
@settings(deadline=None)
def test_any_text_becomes_one_line(text: str) -> None:
    assert len(logs.one_line(text).splitlines()) <= 1


def test_an_event_is_a_line_with_time_level_and_process(tmp_path: Path) -> None:
    message = "first\nsecond\r\u2028third \ud800"
    result = run(tmp_path / "logs", f"logging.info({json.dumps(message)}); logging.warning('careful')")
    lines = (tmp_path / "logs" / "test.log").read_text().splitlines()
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}[+-]\d\d:\d\d INFO test first.*third \S+", lines[0])
    assert lines[1].endswith(" WARNING test careful")
    assert result.stderr == "WARNING careful\n"


def test_nobody_waits_for_a_reader_of_stderr(tmp_path: Path) -> None:
    """A pipe holds 64 KiB; what does not fit is in the file, and counted when somebody reads again."""
    code = (
        "import logging; from pathlib import Path; from robocorba import logs\n"
        f"logs.setup('test', Path({str(tmp_path)!r}))\n"
        "for number in range(2000): logging.warning('%d %s', number, 'x' * 100)\n"
        "logging.warning('y' * 5000)\n"
        "print('done', flush=True)\n"
        "input()\n"
        "logging.warning('last')"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout and process.stderr and process.stdin
        stdout, waiting = process.stdout, threading.Timer(60.0, process.kill)
        waiting.start()
        assert stdout.readline() == "done\n"
        read = [process.stderr.readline() for _ in range(100)]
        process.stdin.write("\n")
        process.stdin.close()
        read += process.stderr.readlines()
        waiting.cancel()
    assert read[0].startswith("WARNING 0 x") and read[-1] == "WARNING last\n"
    (gap,) = (line for line in read if "lines before this one are missing" in line)
    assert int(gap.split()[1]) == 2002 - len(read) + 1
    assert len((tmp_path / "test.log").read_text().splitlines()) == 2002


def test_what_ends_the_process_is_logged_with_its_traceback(tmp_path: Path) -> None:
    result = run(tmp_path, "1 / 0")
    assert result.returncode == 1
    assert result.stderr == "CRITICAL ZeroDivisionError: division by zero\n"
    (line,) = (tmp_path / "test.log").read_text().splitlines()
    assert "CRITICAL test ZeroDivisionError: division by zero\\nTraceback" in line


def test_files_stay_bounded(tmp_path: Path) -> None:
    run(tmp_path, "logs.MAX_BYTES = 1000; logs.setup('test', folder)\nfor n in range(200): logging.info('%d', n)")
    files = sorted(tmp_path.iterdir())
    assert len(files) == 1 + logs.OLD_FILES
    assert all(file.stat().st_size <= 1000 for file in files)
    assert files[0].read_text().endswith(" 199\n")


def test_a_folder_that_cant_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ServiceError, match=r"file/x\.log"):
        logs.open_log("x", tmp_path / "file")


def test_a_full_disk_is_survived_and_counted(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x.log").symlink_to("/dev/full")
    log = logs.open_log("x", tmp_path)
    for number in range(3):
        log.error("%d", number)
    (tmp_path / "x.log").unlink()
    (tmp_path / "x.log").write_text("a part of a li")
    log.handlers[0].close()  # opened again by the next line
    for number in range(3, 5):
        log.error("%d", number)
    part, *lines = (tmp_path / "x.log").read_text().splitlines()
    assert part == "a part of a li"
    assert [line.partition(" x ")[2].partition(" lines")[0] for line in lines] == ["3", "3", "4"]
    assert capfd.readouterr().err == ""


def test_a_folder_that_is_gone_is_survived(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    log = logs.open_log("x", tmp_path / "logs")
    log.handlers[0].close()
    shutil.rmtree(tmp_path / "logs")
    log.error("nobody reads this")
    assert capfd.readouterr().err == ""
