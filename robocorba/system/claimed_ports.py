"""Ports for servers that a program starts on its own machine and ends again."""

from __future__ import annotations

import contextlib
import random
import socket
from collections.abc import Iterator

from robocorba.errors.services import StartFailed

HOST = "127.0.0.1"
#: Ports of a block. Its last one stays bound during the claim, so that other programs see that it is taken.
PORTS_PER_BLOCK = 20
#: Below the ports that the system gives to connections: between the choice of one of those and the start of its
#: server, any connection of any process may get it.
BLOCKS = range(12000, 32000, PORTS_PER_BLOCK)


@contextlib.contextmanager
def claimed_ports() -> Iterator[int]:
    """The first of 19 successive ports that are free now and that no other program gets from here inside the `with`.
    Raises StartFailed."""
    for first in random.sample(BLOCKS, len(BLOCKS)):
        claim = socket.socket()
        with claim:
            try:
                claim.bind((HOST, first + PORTS_PER_BLOCK - 1))
                for port in range(first, first + PORTS_PER_BLOCK - 1):
                    with socket.socket() as probe:
                        probe.bind((HOST, port))
            except OSError:
                continue
            yield first
            return
    raise StartFailed(f"no {PORTS_PER_BLOCK} successive ports of {BLOCKS.start} to {BLOCKS.stop} are free on {HOST}")
