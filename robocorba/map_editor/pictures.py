"""Opens pictures of maps, which may be larger than Pillow expects, and saves drawn ones."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import IO

from PIL import Image

from robocorba.errors.files import OutputError
from robocorba.system.output_files import write_outputs

# Callers check the size. For the whole process: warnings.catch_warnings is not thread-safe.
warnings.filterwarnings("ignore", category=Image.DecompressionBombWarning)


def open_picture(source: Path | IO[bytes], formats: tuple[str, ...]) -> Image.Image:
    """A picture in one of Pillow's `formats`; its pixels are not read yet. Raises DecompressionBombError above 179 Mpx,
    and Pillow's exceptions for damaged files."""
    return Image.open(source, formats=formats)


def save_picture(picture: Image.Image, path: Path, inputs: Iterable[str | Path] = ()) -> None:
    """Write a picture in the format of its suffix, in place of an earlier one but never of the `inputs` from which it
    was drawn. Raises OutputError."""
    drawn = io.BytesIO()
    try:
        picture.save(drawn, Image.registered_extensions()[path.suffix.lower()])
    except (KeyError, ValueError, OSError):
        raise OutputError(path, "a picture's name ends with .png or another format of pictures") from None
    write_outputs({path: drawn.getvalue()}, inputs)
