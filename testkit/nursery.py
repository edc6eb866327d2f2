"""Processes of tests as forks of one that has loaded them: a robot is there for a tenth of the processor time.

They are real processes, children of this one, with pipes and signals of their own. Only the loading of modules and
kernels is left out, of `robocorba up` that of its servers, too."""

from __future__ import annotations

import json
import os
import shlex
import socket
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from robocorba.commands import SUBCOMMANDS
from robocorba.system.supervision.children import set_subreaper
from robocorba.system.supervision.launch import ModuleRun, bound_command, module_command
from robocorba.system.supervision.warm_parent import ENVIRONMENT, MAX_REQUEST
from testkit.json_process import ROOT

#: Timeout for loading a module, whose kernels may have to be compiled, and for a fork [s].
LIMIT_S = 300.0
#: What may differ between the environment of the nursery and that of a fork: modules do not read it when loaded.
FREE_VARIABLES = ("ROBOCORBA_NAMING", "ROBOCORBA_STATE", "XDG_STATE_HOME", "PYTEST_CURRENT_TEST", "ECHO_MODE")
#: Modules that have a main(arguments) for forks, or the beginning of their names.
FORKED_MODULES = ("robocorba.servers.", "tests.system.echo_up")


class Nursery:
    """Forks processes of this one; the end of its `with` ends it, but not them. To be made in the main thread: what it
    forks ends with that."""

    def __init__(self) -> None:
        self._environment = _fixed(os.environ)
        self._lock = threading.Lock()
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.settimeout(LIMIT_S)
        command = (
            *("env", f"PYTHONPATH={ROOT}", *ENVIRONMENT),
            *module_command("robocorba.system.supervision.warm_parent", str(theirs.fileno())),
        )
        with theirs:
            self._process = subprocess.Popen(
                bound_command(*command), stdin=subprocess.DEVNULL, cwd="/", pass_fds=(theirs.fileno(),)
            )

    def __enter__(self) -> Nursery:
        return self

    def __exit__(self, *_: object) -> None:
        self._channel.close()
        self._process.wait(LIMIT_S)

    def start(self, command: Sequence[str], **options: Any) -> ForkedProcess | None:
        """Start a command of RoboCorba, options as of subprocess.Popen; None for one that can't be forked."""
        if _fixed(options.get("env", os.environ)) != self._environment:
            return None
        if not (modules := _modules(command)):
            return None
        *others, run = modules
        for name in others:
            self._ask({"module": name})
        return ForkedProcess(self, run, shlex.join(command), **options)

    def fork(
        self, run: ModuleRun, title: str, cwd: str, environment: dict[str, str], descriptors: Sequence[int]
    ) -> int:
        """The process id of a new child of this process. descriptors: its stdin, stdout and stderr."""
        request = {"arguments": run.arguments, "title": title, "cwd": cwd, "environment": environment}
        return int(self._ask({"module": run.name, **request}, descriptors)["pid"])

    def _ask(self, request: dict[str, Any], descriptors: Sequence[int] = ()) -> dict[str, Any]:
        with self._lock:
            set_subreaper(True)
            try:
                socket.send_fds(self._channel, [json.dumps(request).encode()], descriptors)
                answer: dict[str, Any] = json.loads(self._channel.recv(MAX_REQUEST) or '{"error": "it has ended"}')
            finally:
                set_subreaper(False)
        if "error" in answer:
            raise OSError(f"the nursery can't start {request['module']}: {answer['error']}")
        return answer


class ForkedProcess(subprocess.Popen[str]):
    """A process of a nursery, which can be used like any other that was started with pipes for text."""

    def __init__(self, nursery: Nursery, run: ModuleRun, title: str, **options: Any) -> None:
        self._nursery, self._run, self._title = nursery, run, title
        super().__init__(title, text=True, **options)

    def _execute_child(self, *arguments: Any) -> None:
        """In place of fork and exec, with their arguments in the order of Popen's own method."""
        cwd, environment = arguments[5:7]
        stdin, stdout, stderr = arguments[10], arguments[13], arguments[15]
        try:
            self.pid = self._nursery.fork(self._run, self._title, str(cwd), environment, (stdin, stdout, stderr))
        finally:
            for descriptor in (stdin, stdout, stderr):
                os.close(descriptor)
        self._child_created = True


def _fixed(environment: Any) -> dict[str, str]:
    return {name: value for name, value in environment.items() if name not in FREE_VARIABLES}


def _modules(command: Sequence[str]) -> tuple[Any, ...]:
    """The modules to load for a command, and last the one to run; empty for other programs."""
    *start, _ = module_command("")
    if list(command[: len(start)]) == start:
        name, *arguments = command[len(start) :]
        return (ModuleRun(name, tuple(arguments)),) if name.startswith(FORKED_MODULES) else ()
    if Path(command[0]).name != "robocorba" or len(command) < 2 or command[1] not in SUBCOMMANDS:
        return ()
    _, name, *arguments = command
    if name == "robot":  # becomes another process, which is the one that is meant
        return (ModuleRun("robocorba.clients.robot", tuple(arguments)),)
    if name == "up":
        return (ModuleRun("testkit.forked_system", tuple(arguments)),)
    module = f"robocorba.commands.{SUBCOMMANDS[name][0]}"
    return (module, ModuleRun("robocorba.commands", (name, *arguments)))
