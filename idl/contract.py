"""What a change of the IDL breaks for clients that were compiled before it.

    python contract.py [RELEASED_FOLDER]

Compares the IDL files beside this one with those of the last release, in `released/VERSION`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from make_stubs import idl_files, omniidl

HERE = Path(__file__).resolve().parent
_INTERFACE = re.compile(r"interface :(.*)")


def released() -> Path:
    """The folder with the IDL of the last release."""
    return max((HERE / "released").iterdir(), key=lambda folder: numbers(folder.name))


def numbers(version: str) -> list[int]:
    """The numbers of a version such as 0.1.0."""
    return [int(part) for part in version.split(".")]


def signatures(files: Iterable[str]) -> dict[str, str]:
    """The signature of each declaration in IDL files, by its repository id. Raises as `omniidl` does."""
    lines = omniidl("-p", str(HERE), "-b", "signatures", *files).splitlines()
    return dict(line.split("\t", 1) for line in lines)


def broken(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """What a client that was compiled with the signatures `before` can't use any more, a sentence each.

    A new declaration, operation or base interface breaks nothing. A new member, enumerator, parameter or exception
    does: clients read by position, and an exception that they do not know reaches them as UNKNOWN."""
    found = []
    for declaration, signature in before.items():
        current = now.get(declaration)
        if current is None:
            found.append(f"{declaration} is gone; it was: {signature}")
        elif current != signature and not _bases(signature) <= _bases(current):
            found.append(f"{declaration} was: {signature}; is: {current}")
    return found


def _bases(signature: str) -> set[str]:
    """The bases of an interface; of anything else the signature itself."""
    found = _INTERFACE.fullmatch(signature)
    return {"interface", *(each.strip() for each in found[1].split(","))} - {""} if found else {signature}


if __name__ == "__main__":
    before = Path(sys.argv[1]) if len(sys.argv) > 1 else released()
    sys.exit("\n".join(broken(signatures(idl_files(before)), signatures(idl_files(HERE)))) or 0)
