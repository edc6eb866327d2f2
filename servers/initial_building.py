"""The initial building of a map editor server: the stored one, that of a file, or the sample.

robocorba.map_editor.formats takes 0.2 s to load, and a start from the store does not need it.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
from pathlib import Path

import msgspec

from robocorba.errors.maps import MapFileError
from robocorba.errors.services import ServiceError
from robocorba.map_editor.samples import sample_path
from robocorba.map_editor.store import FIRST_VERSION, MapStore
from robocorba.system.damaged_files import set_aside
from robocorba.system.decoding import decode_json

#: Sample to serve without a file and without a store.
DEFAULT_SAMPLE = "five-floors"
_log = logging.getLogger(__name__)


class Origin(msgspec.Struct):
    """The source file of a store and the SHA-256 of its content, saved beside the store."""

    file: str
    sha256: str


def open_store(path: Path, building: Path | None) -> MapStore:
    """Open the store at `path`, or create it from the file `building` (any readable format).

    An existing store has priority over its own source file. A store without edits is recreated
    from a different file. Raises ServiceError if edits would be lost, MapFileError if a file
    is invalid, AlreadyRunning if another process has the store open."""
    path.parent.mkdir(parents=True, exist_ok=True)
    origin_file = path.with_suffix(".origin.json")
    if path.exists():
        if building is None:
            return MapStore(path)
        origin = _origin(building)
        if _read_origin(origin_file) == origin:
            return MapStore(path)
        with MapStore(path) as store:
            stored = store.load()
            if stored.version != FIRST_VERSION:
                raise ServiceError(
                    f"{path.parent} holds edits of the map {stored.building.name!r}, which was not created from "
                    f"the present {building}; choose another --state, or omit --building to keep those edits"
                )
    # Imported here: they take 0.3 s to load, and a server must restart quickly.
    from robocorba.map_editor.checking import blocked, summaries
    from robocorba.map_editor.formats import read_map

    file = building or sample_path(DEFAULT_SAMPLE)
    imported = read_map(file)
    for loss in imported.losses:
        _log.warning("%s: %s", file, loss)
    for summary in summaries(blocked(imported.building)):
        _log.warning("%s: %s", file, summary)
    path.unlink(missing_ok=True)  # only when its replacement is ready
    store = MapStore.create(path, imported.building)
    origin_file.write_bytes(msgspec.json.encode(_origin(file)))
    return store


def _origin(file: Path) -> Origin:
    try:
        return Origin(str(file.absolute()), hashlib.sha256(file.read_bytes()).hexdigest())
    except OSError as error:
        raise MapFileError(str(file), 0, "", error.strerror or str(error)) from None


def _read_origin(origin_file: Path) -> Origin | None:
    """None if it is missing, or damaged and set aside."""
    with contextlib.suppress(OSError):
        try:
            return decode_json(origin_file.read_bytes(), Origin)
        except (msgspec.MsgspecError, ValueError) as error:
            set_aside(origin_file, str(error), "a map with edits is taken for one that was not made from --building")
    return None
