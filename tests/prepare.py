"""Prepares a run of the suite: compiles kernels and tests once. Else all workers would do it at the same time."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from robocorba.commands.compiling import compile_with_progress

#: Compiles tests and their assertions, and everything that they import.
COLLECT = (sys.executable, "-m", "pytest", "--collect-only", "-qq")


def main() -> None:
    with subprocess.Popen(COLLECT, stdout=subprocess.DEVNULL), tempfile.TemporaryDirectory() as logs:
        compile_with_progress(Path(logs))


if __name__ == "__main__":
    main()
