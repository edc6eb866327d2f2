"""Which virtual sensor servers the simulation server admits."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import SensorRefused
from robocorba.simulation.sensor_admission import SensorAdmission, proof_of, read_token, system_token


@pytest.fixture
def token(tmp_path: Path) -> str:
    return system_token(tmp_path / "sensors.token")


@pytest.fixture
def admission(tmp_path: Path, token: str) -> SensorAdmission:
    (tmp_path / "ports.json").write_text('{"sensor_s1": 2812, "map_editor": 2810}')
    return SensorAdmission(token, tmp_path / "ports.json", "127.0.0.1")


def test_the_token_is_made_once_and_for_this_user_only(tmp_path: Path, token: str) -> None:
    file = tmp_path / "sensors.token"
    assert system_token(file) == read_token(file) == token
    assert file.stat().st_mode & 0o777 == 0o600
    file.write_text("")
    with pytest.raises(ServiceError, match="damaged"):
        system_token(file)
    assert read_token(tmp_path / "missing") == ""


def test_a_proof_is_good_for_one_name_and_one_reference(admission: SensorAdmission, token: str) -> None:
    admission.check("s1", "IOR:1", proof_of(token, "s1", "IOR:1"))
    for name, uri, proof in (
        ("s2", "IOR:1", proof_of(token, "s1", "IOR:1")),
        ("s1", "IOR:2", proof_of(token, "s1", "IOR:1")),
        ("s1", "IOR:1", proof_of("", "s1", "IOR:1")),
        ("s1", "IOR:1", token),
        ("s1", "IOR:1", ""),
        ("s1", "IOR:1", "ä\ud800"),
        ("s 1", "IOR:1", proof_of(token, "s 1", "IOR:1")),
    ):
        with pytest.raises(SensorRefused):
            admission.check(name, uri, proof)


def test_a_server_without_a_token_is_one_of_the_system_at_its_own_port(admission: SensorAdmission, token: str) -> None:
    assert admission.endpoint_of("s1") == "127.0.0.1:2812"
    for name in ("s2", "map_editor", "", "../s1"):
        with pytest.raises(SensorRefused):
            admission.endpoint_of(name)
    admission.check("s1", "IOR:1", proof_of(token, "s1", "IOR:1"))
    with pytest.raises(SensorRefused):
        admission.endpoint_of("s1")
