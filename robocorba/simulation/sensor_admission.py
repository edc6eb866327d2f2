"""Which virtual sensor servers belong to the system: those that know the token in the state folder."""

from __future__ import annotations

import hashlib
import hmac
import logging
import os
import re
import secrets
from pathlib import Path

import msgspec

from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import SensorRefused
from robocorba.system.decoding import decode_json

_log = logging.getLogger(__name__)


class SensorAdmission:
    """token: the secret of the servers. ports: file with the port of each server that `robocorba up` started. host: of
    these. Servers of earlier versions know no token; they are admitted at these ports only."""

    def __init__(self, token: str, ports: Path, host: str) -> None:
        self._token, self._ports, self._host = token, ports, host
        #: Names that were registered with the token, and those that were refused; the latter are logged once.
        self._proved: set[str] = set()
        self._refused: set[str] = set()

    def check(self, name: str, uri: str, proof: str) -> None:
        """Admit a server at the URI of its reference if its proof shows that it knows the token.

        Raises SensorRefused."""
        if not re.fullmatch("[A-Za-z0-9_-]{1,60}", name):
            raise SensorRefused(name, "its name is not 1 to 60 letters, digits or _ -")
        if not hmac.compare_digest(proof.encode(errors="replace"), proof_of(self._token, name, uri).encode()):
            reason = "it does not know the token; copy the system's file sensors.token into its state folder"
            self._note_refusal(name, reason)
            raise SensorRefused(name, reason)
        self._proved.add(name)

    def endpoint_of(self, name: str) -> str:
        """HOST:PORT of a server of `robocorba up` that reports without a token.

        Raises SensorRefused if there is none, or if it has registered with the token."""
        port = None if name in self._proved else self._known_ports().get(f"sensor_{name}")
        if port is None:
            reason = "it has to register with the token"
            self._note_refusal(name, reason)
            raise SensorRefused(name, reason)
        return f"[{self._host}]:{port}" if ":" in self._host else f"{self._host}:{port}"

    def _known_ports(self) -> dict[str, int]:
        try:
            return decode_json(self._ports.read_bytes(), dict[str, int])
        except (OSError, msgspec.MsgspecError):
            return {}

    def _note_refusal(self, name: str, reason: str) -> None:
        if name not in self._refused and len(self._refused) < 100:
            self._refused.add(name)
            _log.warning("virtual sensor server %.80r is refused: %s", name, reason)


def proof_of(token: str, name: str, uri: str) -> str:
    """The proof that the sender of a reference knows the token, which itself is never sent."""
    return hmac.new(token.encode(), f"{name}\n{uri}".encode(), hashlib.sha256).hexdigest()


def system_token(file: Path) -> str:
    """The token in `file`, which is created for this user only if it is missing. Raises ServiceError."""
    try:
        token = secrets.token_urlsafe(24)
        with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as out:
            out.write(token)
        return token
    except FileExistsError:
        pass
    except OSError as error:
        raise ServiceError(f"can't write {file}: {error.strerror}") from None
    token = read_token(file)
    if len(token) < 16:
        raise ServiceError(f"{file} is damaged; remove it")
    return token


def read_token(file: Path) -> str:
    """The token in `file`; empty if it can't be read."""
    try:
        return file.read_text().strip()
    except (OSError, UnicodeDecodeError):
        return ""
