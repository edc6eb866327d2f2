"""Defaults that a user keeps in robocorba.toml: naming service, state folder or instance, and in tables such as [up] or
[events.tail] options of commands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import platformdirs

from robocorba.errors.services import ServiceError
from robocorba.system.decoding import read_text

#: Its name, in the current folder, else in the user's folder for configuration.
DEFAULTS_FILE = "robocorba.toml"


class InvalidDefaults(ServiceError):
    """`file` is no robocorba.toml, or says what means nothing."""

    def __init__(self, file: Path, reason: str) -> None:
        self.file, self.reason = file, reason
        super().__init__(f"{file}: {reason}")


def read_defaults() -> tuple[Path | None, dict[str, Any]]:
    """The file, None if there is none, and what it says. Raises InvalidDefaults."""
    for folder in (Path.cwd(), Path(platformdirs.user_config_dir("robocorba", False))):
        file = folder / DEFAULTS_FILE
        try:
            return file, msgspec.toml.decode(read_text(file))
        except FileNotFoundError:
            continue
        except (OSError, ValueError, ServiceError) as error:
            raise InvalidDefaults(file, str(error)) from None
    return None, {}


def text_of(file: Path | None, members: dict[str, Any], name: str) -> str:
    """A member that has to be a text; empty without one. Raises InvalidDefaults."""
    if file and not isinstance(members.get(name, ""), str):
        raise InvalidDefaults(file, f"{name} is no text")
    return str(members.get(name, ""))
