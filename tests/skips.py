"""Where everything is installed (ROBOCORBA_NO_SKIPS=1, as `.ci/run` sets it), a test that is skipped fails.

What is skipped in silence for want of a program is not tested at all: events to foreign channels were lost for a
release while the test that shows it was skipped everywhere."""

from __future__ import annotations

import os
import platform
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

#: Skips that are no fault there: what their reasons contain, and why nothing can be installed against it.
ALLOWED = {
    "network namespaces": "containers may not make them, even as root",
    "descriptors of its child": "ptrace may be restricted in containers",
    "this omniORB has its SSL transport": "the test is about one that has not",
    "of glibc": "other systems have another allocator",
}
if platform.machine() != "x86_64":
    ALLOWED["foxglove-sdk is not installed"] = ALLOWED["ROS 2 is not installed"] = "it has wheels for x86-64 only"


def is_unexpected(reason: str) -> bool:
    """Whether a skip with this reason fails here."""
    return os.environ.get("ROBOCORBA_NO_SKIPS") == "1" and not any(part in reason for part in ALLOWED)


def _fail(report: Any, longrepr: object) -> None:
    """Turn the report of a skip into one of a failure, unless it is allowed."""
    reason = str(longrepr[2]) if isinstance(longrepr, tuple) else str(longrepr)
    if is_unexpected(reason):
        report.outcome = "failed"
        report.longrepr = f"an unexpected skip ({reason}): install what it needs, or see {Path(__file__).name}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.skipped and not hasattr(report, "wasxfail"):
        _fail(report, report.longrepr)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    if report.skipped:
        _fail(report, report.longrepr)
    return report
