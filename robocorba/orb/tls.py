"""TLS between the processes of a guarded system, where omniORB has its SSL transport.

Beside the file of a role are a user's certificate with its key, and the authorities that it trusts. Both ends of a
connection show a certificate, and refuse one that none of these authorities has signed.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path

from robocorba.errors.services import ServiceError

#: The authorities, and the certificate with its key, as PEM files.
AUTHORITIES, OWN = "ca.pem", "tls.pem"


def load_transport() -> None:
    """Load omniORB's SSL transport, before an ORB starts. Raises ServiceError."""
    try:
        importlib.import_module("omniORB.sslTP")
    except ImportError:
        raise ServiceError(
            "--tls needs omniORB's SSL transport (omniORB.sslTP), which omniORB of PyPI (jeteve-omniorb) "
            "lacks: use an omniORBpy built with OpenSSL, or a VPN"
        ) from None


def options(folder: Path, others: Mapping[str, str]) -> dict[str, str]:
    """The ORB's options for the files in a folder; others: its other options. Raises ServiceError."""
    load_transport()
    for name in (AUTHORITIES, OWN):
        if not (folder / name).is_file():
            raise ServiceError(f"can't use TLS: there is no {folder / name}")
    rules = {
        option: others.get(option, "* tcp").replace("tcp", "ssl")
        for option in ("clientTransportRule", "serverTransportRule")
    }
    # omniORB loads a key only if there is a password, also one that is not encrypted.
    files = {"sslCAFile": str(folder / AUTHORITIES), "sslKeyFile": str(folder / OWN), "sslKeyPassword": "none"}
    return {**files, "sslVerifyMode": "peer,fail", **rules, "endPoint": others["endPoint"].replace("tcp", "ssl", 1)}
