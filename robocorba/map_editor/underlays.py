"""Pictures below the maps of floors, to draw over: a scanned plan, a photograph of a drawing."""

from __future__ import annotations

import io
import math
from typing import NamedTuple

from robocorba.errors.maps import InvalidElement
from robocorba.map_editor.element_rules import MAX_NUMBER
from robocorba.map_editor.model import ElementKind
from robocorba.map_editor.spatial.pose import XY

#: Maximum size of a picture [bytes] and of its sides [px]: a browser must be able to show it.
MAX_PICTURE_BYTES, MAX_SIDE_PX = 8 * 2**20, 12_000
#: Maximum size of all pictures of a building [bytes]: they share the file of the map.
MAX_TOTAL_BYTES = 512 * 2**20


class Underlay(NamedTuple):
    """A picture (PNG or JPEG), its lower left corner [m] and metres per pixel."""

    picture: bytes
    origin: XY
    resolution: float


def check_underlay(floor: str, underlay: Underlay) -> None:
    """Raise InvalidElement unless the underlay of `floor` is a whole picture with a position and a resolution."""
    reason = _number_fault(underlay) or _picture_fault(underlay.picture)
    if reason:
        raise invalid_underlay(floor, reason)


def invalid_underlay(floor: str, reason: str) -> InvalidElement:
    """The error for an underlay of `floor`."""
    return InvalidElement(ElementKind.FLOOR.value, "", floor, f"its picture: {reason}")


def _number_fault(underlay: Underlay) -> str:
    for axis, value in zip("xy", underlay.origin, strict=True):
        if not math.isfinite(value) or abs(value) > MAX_NUMBER:
            return f"the {axis} of its corner must be a number from {-MAX_NUMBER:g} to {MAX_NUMBER:g}"
    if not 1e-6 <= underlay.resolution <= 1e3:
        return "its resolution must be from 1e-06 to 1000 m per pixel"
    return ""


def _picture_fault(picture: bytes) -> str:
    if len(picture) > MAX_PICTURE_BYTES:
        return f"it has {len(picture)} bytes, at most {MAX_PICTURE_BYTES} are allowed"
    # Imported here: a server must restart quickly.
    from PIL import Image

    from robocorba.map_editor.pictures import open_picture

    try:
        with open_picture(io.BytesIO(picture), ("PNG", "JPEG")) as image:
            if max(image.size) > MAX_SIDE_PX:
                return f"it has {image.width} x {image.height} pixels, at most {MAX_SIDE_PX} a side are allowed"
            # All of a progressive JPEG is decoded at once, in 6 bytes a pixel; other pictures are in rows.
            if image.info.get("progressive") and image.width * image.height > 16_000_000:
                return (
                    f"it is a progressive JPEG of {image.width} x {image.height} pixels, at most "
                    "16 million are allowed: save it without 'progressive'"
                )
            if image.format == "PNG":
                image.verify()  # checksums, without decoding
            else:
                image.draft("L", (1, 1))  # decodes an eighth of each side
                image.load()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        return f"it is no PNG or JPEG that can be read ({str(error)[:80]})"
    return ""
