"""The extras of RoboCorba: packages that only some of its features need, see setup.cfg."""

from __future__ import annotations

import json
import re
import urllib.parse
import urllib.request
from importlib import metadata

from robocorba.errors.services import ServiceError


def require_extra(extra: str, purpose: str) -> None:
    """Raise ServiceError if a package of an extra is not installed. purpose: what needs it, in the plural."""
    if absent := missing(extra):
        needed, checkout = requirements(extra), _checkout()
        install = f"--editable '{checkout}[{extra}]'" if checkout else " ".join(f"'{needed[name]}'" for name in absent)
        raise ServiceError(f"{purpose} need the extra {extra} ({', '.join(absent)}): pip install {install}")


def missing(extra: str) -> list[str]:
    """The packages of an extra that are not installed."""
    return [name for name in requirements(extra) if not _is_installed(name)]


def requirements(extra: str) -> dict[str, str]:
    """By package, what an extra adds to RoboCorba, with its range of versions; nothing if RoboCorba is not installed
    but lies beside, as for its own build."""
    try:
        lines = metadata.requires("robocorba") or []
    except metadata.PackageNotFoundError:
        return {}
    found: dict[str, str] = {}
    for requirement, _, marker in (line.partition(";") for line in lines):
        if re.search(rf"extra == ['\"]{extra}['\"]", marker):
            own = re.fullmatch(r"robocorba\[(.+)\]", requirement.strip())
            for part in own[1].split(",") if own else ():
                found |= requirements(part)
            if not own:
                found[re.split(r"[^\w.-]", requirement, maxsplit=1)[0]] = requirement.strip()
    return found


def _is_installed(package: str) -> bool:
    try:
        metadata.distribution(package)
    except metadata.PackageNotFoundError:
        return False
    return True


def _checkout() -> str:
    """The folder from which RoboCorba is installed editable; empty if it is installed otherwise. It is on no index."""
    source = json.loads(metadata.distribution("robocorba").read_text("direct_url.json") or "{}")
    if not source.get("dir_info", {}).get("editable"):
        return ""
    return urllib.request.url2pathname(urllib.parse.urlsplit(source["url"]).path)
