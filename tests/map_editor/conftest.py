"""What the tests of maps share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import Building
from robocorba.map_editor.store import MapStore
from testkit.buildings import two_floors


@pytest.fixture
def building() -> Building:
    """Two floors in order."""
    return two_floors()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Where a store may be made."""
    return tmp_path / "map.db"


@pytest.fixture
def store(file: Path, building: Building) -> Iterator[MapStore]:
    """A new store of the building."""
    with MapStore.create(file, building) as store:
        yield store


@pytest.fixture
def editor(store: MapStore) -> BuildingEditor:
    """The editor of that store."""
    return BuildingEditor(store)
