"""The files of the roles of a guarded system."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from robocorba.errors.services import ServiceError
from robocorba.roles import Role
from robocorba.settings import Address, InvalidSetting, RoleNaming, Settings, robot_keys, role_file
from robocorba.supervision.access import Access, remove_access

ADDRESS = Address("127.0.0.1", 2809)


def read(state: Path, role: Role = Role.OPERATOR, naming: str | None = None) -> Address:
    return Settings.read(naming, state, {}, role).naming


def test_each_role_has_a_file_that_only_this_user_reads(tmp_path: Path) -> None:
    access = Access.create(tmp_path, ADDRESS)
    for role in Role:
        naming = RoleNaming.read(role_file(tmp_path, role))
        assert (naming.role, naming.key, str(naming)) == (role, access.key(role), str(ADDRESS))
        assert naming.setting == str(role_file(tmp_path, role))
        assert naming.key not in repr(naming)
    assert {stat.S_IMODE(file.stat().st_mode) for file in (tmp_path / "access").iterdir()} == {0o600}
    assert len({access.key(role) for role in Role}) == len(Role)


def test_keys_outlive_a_move_and_a_start_without_guard(tmp_path: Path) -> None:
    keys = Access.create(tmp_path, ADDRESS).keys
    remove_access(tmp_path)
    assert not role_file(tmp_path, Role.OPERATOR).exists()
    assert Access.create(tmp_path, Address("10.0.0.1", 2810)).keys == keys
    assert str(RoleNaming.read(role_file(tmp_path, Role.ROBOT))) == "10.0.0.1:2810"


def test_a_robot_has_a_file_of_its_own_until_it_is_removed(tmp_path: Path) -> None:
    access = Access.create(tmp_path, ADDRESS)
    files = {name: access.robot(name) for name in ("A", ".hidden", "a.b", "Ä b%")}
    keys = robot_keys(access.folder)
    assert {name: RoleNaming.read(file).key for name, file in files.items()} == keys
    assert {RoleNaming.read(file).role for file in files.values()} == {Role.ROBOT}
    assert {stat.S_IMODE(file.stat().st_mode) for file in files.values()} == {0o600}
    assert len({*keys.values(), access.key(Role.ROBOT)}) == 5
    assert access.robot("A") == files["A"]
    Access.create(tmp_path, Address("10.0.0.1", 2810))
    assert robot_keys(access.folder) == keys
    assert str(RoleNaming.read(files["A"])) == "10.0.0.1:2810"
    files["A"].unlink()
    access.robot("A")
    assert robot_keys(access.folder)["A"] != keys["A"]
    for name in ("", "a/b", "x" * 201, "Ä" * 60):
        with pytest.raises(ServiceError):
            access.robot(name)


def test_settings_take_a_file_or_that_of_the_state_folder(tmp_path: Path) -> None:
    assert read(tmp_path) == ADDRESS
    access = Access.create(tmp_path, ADDRESS)
    assert read(tmp_path) == access.naming(Role.OPERATOR)
    assert read(tmp_path, Role.ROBOT) == access.naming(Role.ROBOT)
    assert read(tmp_path, naming=str(role_file(tmp_path, Role.OBSERVER))) == access.naming(Role.OBSERVER)
    assert read(tmp_path, naming="127.0.0.1:2809") == ADDRESS


@pytest.mark.parametrize(
    "text",
    [
        "",
        "IOR:00",
        "corbaloc:iiop:1.2@127.0.0.1:2809/MapEditor",
        f"corbaloc:iiop:1.2@127.0.0.1:2809/access/king/{'0' * 64}",
        f"corbaloc:iiop:1.2@127.0.0.1:70000/access/robot/{'0' * 64}",
    ],
)
def test_what_is_no_file_of_a_role(tmp_path: Path, text: str) -> None:
    file = tmp_path / "x.ior"
    with pytest.raises(InvalidSetting, match="No such file"):
        RoleNaming.read(file)
    file.write_text(text)
    with pytest.raises(InvalidSetting):
        RoleNaming.read(file)


def test_damaged_keys_are_one_line(tmp_path: Path) -> None:
    Access.create(tmp_path, ADDRESS)
    (tmp_path / "access" / "keys.json").write_text('{"robot": "short"}')
    with pytest.raises(ServiceError, match=r"keys.json is damaged"):
        Access.create(tmp_path, ADDRESS)
