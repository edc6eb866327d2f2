"""The data of the naming service: mended before it starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocorba.errors.services import ServiceError
from robocorba.supervision.naming_data import intact_part, mend_naming_data
from tests.damage import damage

HEADER = b"port 2809\npersistent 7670036b0100337f\ncreate 4e616d6553657276696365\n"
LINES = (
    HEADER
    + b"create 7670036b0100337f00000001\n"
    + b"bind IOR:01 RoboCorba  ncontext IOR:02\n"
    + b"bind IOR:02 with\\ space k\\ind nobject IOR:03\n"
    + "bind IOR:02 \xfcn\x1bi  nobject IOR:03\n".encode()
    + b"unbind IOR:02 with\\ space \ndestroy IOR:02\n"
)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    file = tmp_path / "omninames.dat"
    file.write_bytes(LINES)
    return file


def test_what_omninames_writes_is_left_alone(data: Path, caplog: pytest.LogCaptureFixture) -> None:
    mend_naming_data(data.parent)
    mend_naming_data(data.parent / "missing")
    assert data.read_bytes() == LINES and list(data.parent.iterdir()) == [data]
    assert caplog.text == ""


@pytest.mark.parametrize("cut", range(1, 40))
def test_a_last_line_that_was_cut_is_dropped(data: Path, cut: int) -> None:
    data.write_bytes(LINES[:-cut])
    mend_naming_data(data.parent)
    kept = data.read_bytes()
    assert LINES.startswith(kept) and kept.endswith(b"\n") and len(kept) <= len(LINES) - cut
    assert intact_part(kept) == kept


def test_a_damaged_line_ends_what_is_kept(data: Path, caplog: pytest.LogCaptureFixture) -> None:
    data.write_bytes(LINES.replace(b"bind IOR:02 with", b"bi\0d IOR:02 with"))
    mend_naming_data(data.parent)
    assert data.read_bytes() == LINES[: LINES.index(b"bind IOR:02 with")]
    assert "omninames.dat is damaged (line 6)" in caplog.text and "4 later changes are lost" in caplog.text


def test_a_damaged_beginning_leads_to_the_earlier_state_else_to_none(data: Path) -> None:
    damaged = damage(data)
    (data.parent / "omninames.bak").write_bytes(HEADER)
    mend_naming_data(data.parent)
    assert data.read_bytes() == HEADER
    assert (data.parent / "omninames.dat.damaged").read_bytes() == damaged
    assert not (data.parent / "omninames.bak").exists()
    data.write_bytes(damaged)
    mend_naming_data(data.parent)
    assert not data.exists()


@pytest.mark.parametrize(("former", "is_used"), [(HEADER, True), (b"damaged", False)])
def test_an_earlier_state_alone_is_used_or_set_aside(data: Path, former: bytes, is_used: bool) -> None:
    """omniNames would not start."""
    data.rename(data.with_suffix(".bak"))
    data.with_suffix(".bak").write_bytes(former)
    mend_naming_data(data.parent)
    assert not data.with_suffix(".bak").exists()
    assert data.exists() == is_used


def test_on_a_full_disk_nothing_is_lost(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    data.write_bytes(LINES[:-5])
    (data.parent / "omninames.bak").write_bytes(HEADER)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", fail)
        with pytest.raises(ServiceError, match="No space left"):
            mend_naming_data(data.parent)
    assert data.read_bytes() == LINES[:-5]
    mend_naming_data(data.parent)
    assert LINES.startswith(data.read_bytes()) and data.read_bytes().startswith(HEADER + b"create")
