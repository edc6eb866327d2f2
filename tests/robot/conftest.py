"""A place for the robots of a module's tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.robot.places import Place


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    place = Place(tmp_path_factory.mktemp("place"))
    yield place
    place.close()
