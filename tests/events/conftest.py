"""A channel for tests of its outlets."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba.events.channel import Channel
from tests.events.samples import open_channel


@pytest.fixture
def channel(tmp_path: Path) -> Iterator[Channel]:
    with open_channel(tmp_path) as channel:
        yield channel
        with channel.lock:
            for proxy in channel.proxy_suppliers.values():
                proxy.end()
