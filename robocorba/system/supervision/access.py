"""The rights to a guarded system: a file for each role, with the URI of the naming context of the role.

    access/keys.json           the keys of the roles, kept so that the files stay valid
    access/observer.ior ...    a URI for each role: who can read the file may do what the role may
    access/robots/NAME.ior     the same for one robot, which may do so as itself only; who removes it ends that right
    access/ca.pem, tls.pem     with TLS: the authorities, and the certificate of this user

Only this user may read them. The files are there while the folder's last `up` was a guarded one.
"""

from __future__ import annotations

import os
import secrets
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import msgspec

from robocorba.errors.services import ServiceError
from robocorba.orb.tls import AUTHORITIES, OWN
from robocorba.system.decoding import decode_json
from robocorba.system.name_table import MAX_PART
from robocorba.system.names import ACCESS
from robocorba.system.roles import Role
from robocorba.system.settings import Address, RoleNaming, robot_files, robot_keys, role_file


@dataclass(frozen=True)
class Access:
    """The files in a state folder. keys: that of each role's naming context."""

    state: Path
    keys: dict[str, str]

    @property
    def folder(self) -> Path:
        return self.state / ACCESS

    @classmethod
    def create(cls, state: Path, address: Address, certificates: Path | None = None) -> Access:
        """Write the files for a naming service at `address`, with new keys if there are none.

        certificates: a folder with the authorities and our certificate, for TLS. Raises ServiceError."""
        folder = state / ACCESS
        try:
            folder.mkdir(mode=0o700, exist_ok=True)
            folder.chmod(0o700)
            file = folder / "keys.json"
            if not file.exists():
                _write(file, msgspec.json.encode({role.name.lower(): secrets.token_hex(32) for role in Role}).decode())
            access = cls.read(state)
            scheme = "ssliop" if certificates else "iiop"
            for role in Role:
                _write(role_file(state, role), f"corbaloc:{scheme}:1.2@{address}/{access.key(role)}\n")
            for name, key in robot_keys(folder).items():
                _write(robot_files(folder) / _file_name(name), f"corbaloc:{scheme}:1.2@{address}/{key}\n")
            if certificates:
                for name in (AUTHORITIES, OWN):
                    _write(folder / name, (certificates / name).read_text())
        except OSError as error:
            raise ServiceError(f"can't use {error.filename or folder}: {error.strerror}") from None
        return access

    @classmethod
    def read(cls, state: Path) -> Access:
        """The access to the system of a state folder. Raises ServiceError."""
        file = state / ACCESS / "keys.json"
        try:
            keys = decode_json(file.read_bytes(), dict[str, str])
            if any(len(keys.get(role.name.lower(), "")) != 64 for role in Role):
                raise msgspec.ValidationError("a key is missing")
        except OSError as error:
            raise ServiceError(f"can't read {file}: {error.strerror}") from None
        except msgspec.MsgspecError as error:
            raise ServiceError(
                f"{file} is damaged ({error}); remove it, and hand out the new files of {ACCESS}/"
            ) from None
        return cls(state, keys)

    def key(self, role: Role) -> str:
        """The object key of the naming context of a role."""
        if role is Role.OBSERVER:
            return "NameService"  # that of every naming service
        return f"{ACCESS}/{role.name.lower()}/{self.keys[role.name.lower()]}"

    def robot(self, name: str) -> Path:
        """The file of one robot, with a new key unless it has one. Raises ServiceError."""
        if not 1 <= len(name) <= MAX_PART or "/" in name:
            raise ServiceError(f"{name!r} can't be the name of a robot: 1 to {MAX_PART} characters without a slash")
        folder = robot_files(self.folder)
        file = folder / _file_name(name)
        if len(file.name) > 255:
            raise ServiceError(f"the name {name[:40]!r}... is too long for a file")
        try:
            folder.mkdir(mode=0o700, exist_ok=True)
            if not file.exists():
                address = self.naming(Role.ROBOT)
                key = f"{ACCESS}/robot/{secrets.token_hex(32)}"
                _write(file, f"corbaloc:{address.scheme}:1.2@{address}/{key}\n")
        except OSError as error:
            raise ServiceError(f"can't use {error.filename or folder}: {error.strerror}") from None
        return file

    def naming(self, role: Role) -> RoleNaming:
        """The naming service as a role sees it. Raises InvalidSetting."""
        return RoleNaming.read(role_file(self.state, role))


def remove_access(state: Path) -> None:
    """Remove the files, not the keys: the system that starts now is not guarded."""
    for role in Role:
        role_file(state, role).unlink(missing_ok=True)


def _file_name(robot: str) -> str:
    """Reversed by robocorba.system.settings.robot_keys; not hidden, whatever the name is."""
    return quote(robot, safe="").replace(".", "%2E") + ".ior"


def _write(file: Path, text: str) -> None:
    """Replace a file atomically by one that only this user can read."""
    new = file.with_suffix(".new")
    new.unlink(missing_ok=True)
    with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as out:
        out.write(text)
    new.replace(file)
