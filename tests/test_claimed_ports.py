"""Ports that only one program gets."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator

import pytest

from robocorba import claimed_ports as module
from robocorba.claimed_ports import HOST, PORTS_PER_BLOCK, claimed_ports
from robocorba.errors.services import StartFailed


@pytest.fixture
def two_blocks(monkeypatch: pytest.MonkeyPatch) -> Iterator[range]:
    """The only blocks to choose from; free, as nothing else uses what is reserved here."""
    with claimed_ports() as first:
        blocks = range(first, first + PORTS_PER_BLOCK - 2, 6)[:2]
        monkeypatch.setattr(module, "PORTS_PER_BLOCK", 6)
        monkeypatch.setattr(module, "BLOCKS", blocks)
        yield blocks


def test_each_claim_gets_its_own_ports(two_blocks: range) -> None:
    with claimed_ports() as first, claimed_ports() as second:
        assert {first, second} == set(two_blocks)
        with pytest.raises(StartFailed, match="no 6 successive ports"), claimed_ports():
            pass
    with claimed_ports() as again:
        assert again in two_blocks


def test_a_block_with_a_port_in_use_is_left_out(two_blocks: range) -> None:
    with socket.create_server((HOST, two_blocks[0] + 3)):
        for _ in range(20):
            with claimed_ports() as port:
                assert port == two_blocks[1]


def test_servers_can_listen_at_all_but_the_last(two_blocks: range) -> None:
    with claimed_ports() as first, contextlib.ExitStack() as stack:
        for port in range(first, first + 5):
            stack.enter_context(socket.create_server((HOST, port)))
        with pytest.raises(OSError), socket.socket() as other:
            other.bind((HOST, first + 5))


def test_the_ports_lie_below_those_that_linux_gives_to_connections_by_default() -> None:
    assert module.BLOCKS.stop <= 32768
