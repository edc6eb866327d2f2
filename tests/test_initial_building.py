"""Opening the store of a server; which building it begins with is proved by tests/system/test_building_option.py."""

from __future__ import annotations

import random
from pathlib import Path

import msgspec
import pytest

from robocorba.initial_building import open_store
from robocorba.maps import native
from robocorba.testing.buildings import two_floors


def test_what_is_blocked_in_a_new_map_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    building = two_floors()
    door = building.floors["L1"].geometrical.doors["d"]
    locked = building.with_element("L1", msgspec.structs.replace(door, locked=True))
    file = tmp_path / "locked.yaml"
    native.save(locked, file)
    for _ in range(2):  # a store that was made before is opened without a word
        with open_store(tmp_path / "state" / "map.sqlite", file) as store:
            assert store.load().building == locked
    assert [record.getMessage() for record in caplog.records] == [
        f"{file}: blocked edges of L1 (1): west-east (locked door 'd' near 10, 5)"
    ]


@pytest.mark.parametrize("content", [random.Random(1).randbytes(200), b"[" * 100_000, b"{}", b""])
def test_a_damaged_origin_is_set_aside(tmp_path: Path, caplog: pytest.LogCaptureFixture, content: bytes) -> None:
    file, map_file = tmp_path / "two.yaml", tmp_path / "map.sqlite"
    native.save(two_floors(), file)
    open_store(map_file, file).close()
    origin = tmp_path / "map.origin.json"
    good = origin.read_bytes()
    origin.write_bytes(content)
    open_store(map_file, file).close()
    assert f"{origin} is damaged" in caplog.text
    assert ((tmp_path / "map.origin.json.damaged").read_bytes(), origin.read_bytes()) == (content, good)
