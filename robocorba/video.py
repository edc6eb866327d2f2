"""Pictures to a video: H.264 in MP4, which every browser and player shows."""

from __future__ import annotations

import io
from pathlib import Path
from types import TracebackType

import av
from av.video.stream import VideoStream
from PIL import Image, UnidentifiedImageError

from robocorba.errors.simulation import VideoError

SUFFIXES = (".mp4", ".m4v", ".mov")
#: Of the sides of a picture, px, and of the rate, pictures a second.
LEAST_PX, MOST_PX, MOST_FPS = 2, 8192, 240
GROUND = "white"
_OPTIONS = {"preset": "veryfast", "crf": "23"}


class VideoFile:
    """A video of `fps` pictures a second, at most MOST_FPS, made in a `with`; what was at `path` is overwritten.

    Its sides are `width` and `height` in px, made even, as H.264 wants them. Raises VideoError."""

    def __init__(self, path: Path, width: int, height: int, fps: int) -> None:
        if path.suffix.lower() not in SUFFIXES:
            raise VideoError(path, f"a video's name ends with {', '.join(SUFFIXES)}")
        if not all(LEAST_PX <= side <= MOST_PX for side in (width, height)):
            raise VideoError(path, f"{width} x {height} is not {LEAST_PX} to {MOST_PX} pixels")
        if not 1 <= fps <= MOST_FPS:
            raise VideoError(path, f"{fps} is not 1 to {MOST_FPS} pictures a second")
        self.path, self.fps = path, fps
        self.size = (width + width % 2, height + height % 2)
        self.count = 0
        try:
            self._container = av.open(str(path), "w", format="mp4")
            self._stream: VideoStream = self._container.add_stream("libx264", rate=fps, options=_OPTIONS)
            self._stream.width, self._stream.height = self.size
            self._stream.pix_fmt = "yuv420p"
            self._container.start_encoding()
        except (OSError, ValueError) as wrong:
            raise VideoError(path, _reason(wrong)) from None

    def add(self, picture: bytes | Image.Image, times: int = 1) -> None:
        """Show a PNG file's content or an image so many `times`, in the upper left corner where it is smaller.

        Raises VideoError."""
        image = self._fitted(picture)
        for _ in range(times):
            frame = av.VideoFrame.from_image(image)
            frame.pts = self.count
            self._write(frame)
            self.count += 1

    def _fitted(self, picture: bytes | Image.Image) -> Image.Image:
        try:
            image = Image.open(io.BytesIO(picture)) if isinstance(picture, bytes) else picture
            image = image.convert("RGB")
        except (UnidentifiedImageError, OSError, SyntaxError) as wrong:
            raise VideoError(self.path, f"not a picture ({wrong})") from None
        if image.size == self.size:
            return image
        fitted = Image.new("RGB", self.size, GROUND)
        fitted.paste(image)
        return fitted

    def _write(self, frame: av.VideoFrame | None) -> None:
        try:
            self._container.mux(self._stream.encode(frame))
        except (OSError, ValueError) as wrong:
            raise VideoError(self.path, _reason(wrong)) from None

    def __enter__(self) -> VideoFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            if self.count:
                self._write(None)
            self._container.close()
        except (OSError, ValueError) as wrong:
            raise VideoError(self.path, _reason(wrong)) from None


def _reason(wrong: OSError | ValueError) -> str:
    return str(getattr(wrong, "strerror", None) or wrong)
