"""Opens pictures of maps, which may be larger than Pillow expects."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import IO

from PIL import Image

# Callers check the size. For the whole process: warnings.catch_warnings is not thread-safe.
warnings.filterwarnings("ignore", category=Image.DecompressionBombWarning)


def open_picture(source: Path | IO[bytes], formats: tuple[str, ...]) -> Image.Image:
    """A picture in one of Pillow's `formats`; its pixels are not read yet. Raises DecompressionBombError above 179 Mpx,
    and Pillow's exceptions for damaged files."""
    return Image.open(source, formats=formats)
