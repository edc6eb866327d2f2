"""How a process starts another one: which module runs, with which import path, and what ends it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

#: Runs a module as `python -P -m` does; that option came with Python 3.11.
_WITHOUT_CURRENT_DIRECTORY = (
    "import sys; sys.path.remove(''); import runpy; sys.argv.pop(0); "
    "runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)"
)
_RUN_MODULE = ("-P", "-m") if sys.version_info >= (3, 11) else ("-c", _WITHOUT_CURRENT_DIRECTORY)
_CHILD = str(Path(__file__).with_name("child.py"))


def module_command(module: str, *arguments: str) -> tuple[str, ...]:
    """The command line that runs a module with this interpreter. The current directory is not on its import path, so a
    file there can't take the place of a module."""
    return (sys.executable, *_RUN_MODULE, module, *arguments)


def bound_command(*command: str) -> tuple[str, ...]:
    """The command line that runs `command` and kills it when this process ends. Start it in the main thread: the kernel
    counts the end of the thread that started it."""
    return (sys.executable, "-I", "-S", _CHILD, str(os.getpid()), *command)
