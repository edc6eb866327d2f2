"""What a failed test leaves in its report: how to run it alone, where its files are, and the ends of its logs."""

from __future__ import annotations

import shlex
from collections.abc import Generator
from pathlib import Path

import pytest

#: Logs that the report of a failed test quotes, the latest first, and how many lines of each.
MAX_LOGS, MAX_LINES = 8, 12
#: The folder of all temporary files of this process, once there is one.
FOLDER = pytest.StashKey[Path]()
_BEGAN_AT = pytest.StashKey[float]()


@pytest.fixture(scope="session", autouse=True)
def folder_of_failures(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> None:
    request.config.stash[FOLDER] = tmp_path_factory.getbasetemp()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    item.stash.setdefault(_BEGAN_AT, call.start)
    report = yield
    if report.failed:
        report.sections.append(("run it alone", f"python -m pytest {shlex.quote(item.nodeid)}"))
        if folder := item.config.stash.get(FOLDER, None):
            report.sections.append(("its files", f"{folder}\n{log_ends(folder, item.stash[_BEGAN_AT])}"))
    return report


def log_ends(folder: Path, since: float) -> str:
    """The last lines of the logs below a folder that were written to since a time [s, time.time]."""
    written = sorted(((file.stat().st_mtime, file) for file in folder.rglob("*.log") if file.is_file()), reverse=True)
    quoted = [file for at, file in written if at >= since][:MAX_LOGS]
    return "\n".join(
        line for file in quoted for line in (f"--- {file}", *file.read_text(errors="replace").splitlines()[-MAX_LINES:])
    )
