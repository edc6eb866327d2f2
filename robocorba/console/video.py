"""Videos from pictures: H.264 in MP4, which all browsers and players support."""

from __future__ import annotations

import io
from pathlib import Path
from types import TracebackType

import av
from av.video.stream import VideoStream
from PIL import Image, UnidentifiedImageError

from robocorba.errors.files import OutputError

#: Accepted suffixes of video files.
SUFFIXES = (".mp4", ".m4v", ".mov")
#: Bounds of the sides of a picture [px].
MIN_PX, MAX_PX = 2, 8192
#: Maximum frame rate [pictures/s].
MAX_FPS = 240


class VideoFile:
    """Context manager that writes a video of `fps` pictures per second, at most MAX_FPS; overwrites `path`.

    width, height: sides [px], rounded up to even numbers as H.264 requires. Raises OutputError."""

    def __init__(self, path: Path, width: int, height: int, fps: int) -> None:
        if path.suffix.lower() not in SUFFIXES:
            raise OutputError(path, f"a video's name ends with {' or '.join(SUFFIXES)}")
        if not all(MIN_PX <= side <= MAX_PX for side in (width, height)):
            raise OutputError(path, f"{width} x {height} is not {MIN_PX} to {MAX_PX} pixels")
        if not 1 <= fps <= MAX_FPS:
            raise OutputError(path, f"{fps} is not 1 to {MAX_FPS} pictures per second")
        self.path, self.fps = path, fps
        self.size = (width + width % 2, height + height % 2)
        self.count = 0
        #: The picture that `hold` appends; None before the first one.
        self._shown: Image.Image | None = None
        try:
            self._container = av.open(str(path), "w", format="mp4")
            options = {"preset": "veryfast", "crf": "23"}
            self._stream: VideoStream = self._container.add_stream("libx264", rate=fps, options=options)
            self._stream.width, self._stream.height = self.size
            self._stream.pix_fmt = "yuv420p"
            self._container.start_encoding()
        except (OSError, ValueError) as error:
            raise OutputError(path, _reason(error)) from None

    def add(self, picture: bytes | Image.Image, times: int = 1) -> None:
        """Append a picture, as PNG data or an image, `times` times; a smaller one goes to the upper left corner.

        Raises OutputError."""
        image = self._fitted(picture)
        for _ in range(times):
            frame = av.VideoFrame.from_image(image)
            frame.pts = self.count
            self._write(frame)
            self.count += 1

    def show(self, picture: bytes | Image.Image, at_s: float) -> None:
        """Show a picture from `at_s` [s] after the video's beginning on; until then the one before it is shown.

        Raises OutputError."""
        image = self._fitted(picture)
        self.hold(at_s)
        self._shown = image

    def hold(self, until_s: float) -> None:
        """Go on showing the latest picture of `show` until this time [s], for one frame at least. Raises
        OutputError."""
        if self._shown:
            self.add(self._shown, times=max(round(until_s * self.fps), 1) - self.count)

    def _fitted(self, picture: bytes | Image.Image) -> Image.Image:
        try:
            image = Image.open(io.BytesIO(picture)) if isinstance(picture, bytes) else picture
            image = image.convert("RGB")
        except (UnidentifiedImageError, OSError, SyntaxError) as error:
            raise OutputError(self.path, f"not a picture ({error})") from None
        if image.size == self.size:
            return image
        fitted = Image.new("RGB", self.size, "white")
        fitted.paste(image)
        return fitted

    def _write(self, frame: av.VideoFrame | None) -> None:
        try:
            self._container.mux(self._stream.encode(frame))
        except (OSError, ValueError) as error:
            raise OutputError(self.path, _reason(error)) from None

    def __enter__(self) -> VideoFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            if self.count:
                self._write(None)
            self._container.close()
        except (OSError, ValueError) as error:
            raise OutputError(self.path, _reason(error)) from None


def _reason(error: OSError | ValueError) -> str:
    return str(getattr(error, "strerror", None) or error)
