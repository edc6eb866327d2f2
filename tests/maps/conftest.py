"""What the tests of maps share."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocorba.maps.model import Building
from robocorba.testing.buildings import two_floors


@pytest.fixture
def building() -> Building:
    """Two floors in order."""
    return two_floors()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Where a store may be made."""
    return tmp_path / "map.db"
