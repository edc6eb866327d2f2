"""`robocorba up` in a process that was forked from one with all servers: its warm parent is a fork, too."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Sequence

from robocorba import commands
from robocorba.system.corba.servers import servers
from robocorba.system.supervision import warm_parent
from robocorba.system.supervision.child import bind_to_parent
from robocorba.system.supervision.launch import module_command
from robocorba.system.supervision.starter import Starter


def preload() -> None:
    """Load the command, and all servers with their kernels."""
    warm_parent.load("robocorba.commands.up")
    for server in servers(["main"], sensors=1):
        warm_parent.load(server.module)


def main(arguments: Sequence[str]) -> None:
    """Run `robocorba up`. Never returns."""
    fork_warm_parent()
    commands.main(("up", *arguments))


def fork_warm_parent() -> None:
    """Have a warm parent with all that this process has loaded."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    pid = os.fork()
    if not pid:
        bind_to_parent(signal.SIGKILL)
        os.setsid()
        ours.close()
        warm_parent.separate()
        warm_parent.set_title(" ".join(module_command(warm_parent.__name__)))
        warm_parent.main(theirs)
        os._exit(0)
    theirs.close()
    Starter.warm = pid, ours
