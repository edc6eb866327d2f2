"""Videos are decoded again: their pictures, their size, their time."""

from __future__ import annotations

import io
from pathlib import Path

import av
import pytest
from PIL import Image

from robocorba.console.video import VideoFile
from robocorba.errors.files import OutputError

COLOURS = ["red", "lime", "blue", "white", "black"]


def png(colour: str, width: int, height: int, mode: str = "RGB") -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (width, height), colour).convert(mode).save(buffer, "PNG")
    return buffer.getvalue()


def decoded(path: Path) -> list[Image.Image]:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        return [frame.to_image() for frame in container.decode(stream)]


def near(image: Image.Image, place: tuple[int, int], colour: str) -> bool:
    found, wanted = image.getpixel(place), Image.new("RGB", (1, 1), colour).getpixel((0, 0))
    assert isinstance(found, tuple) and isinstance(wanted, tuple)
    return max(abs(a - b) for a, b in zip(found, wanted, strict=True)) < 40


@pytest.mark.parametrize(("fps", "size"), [(1, (201, 121)), (10, (200, 120)), (25, (64, 64)), (60, (3, 3))])
def test_pictures_time_and_sides_are_right(tmp_path: Path, fps: int, size: tuple[int, int]) -> None:
    with VideoFile(tmp_path / "a.mp4", *size, fps) as video:
        for colour in COLOURS:
            video.add(png(colour, *size), times=2 * fps)
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.frames == video.count == 2 * fps * len(COLOURS)
        assert stream.average_rate == fps
        assert stream.duration is not None and stream.time_base is not None
        assert float(stream.duration * stream.time_base) == pytest.approx(2.0 * len(COLOURS), abs=1 / fps)
    frames = decoded(tmp_path / "a.mp4")
    assert {frame.size for frame in frames} == {(size[0] + size[0] % 2, size[1] + size[1] % 2)}
    if size > (3, 3):
        middle = size[0] // 2, size[1] // 2
        assert all(near(frame, middle, COLOURS[i // (2 * fps)]) for i, frame in enumerate(frames))


def test_an_exception_leaves_a_video_that_plays(tmp_path: Path) -> None:
    with VideoFile(tmp_path / "nothing.mp4", 64, 64, 10):
        pass
    with pytest.raises(KeyboardInterrupt), VideoFile(tmp_path / "a.mp4", 64, 64, 10) as video:
        for content in (b"", b"no picture", png("red", 64, 64)[:60]):
            with pytest.raises(OutputError, match="not a picture"):
                video.add(content)
        video.add(png("red", 64, 64), times=7)
        raise KeyboardInterrupt
    assert len(decoded(tmp_path / "a.mp4")) == 7
    (tmp_path / "full.mp4").symlink_to("/dev/full")
    with pytest.raises(OutputError, match="No space left"), VideoFile(tmp_path / "full.mp4", 64, 64, 10) as video:
        video.add(png("red", 64, 64))


def test_any_kind_of_picture_is_taken(tmp_path: Path) -> None:
    for mode in ("P", "L", "RGBA", "1"):
        with VideoFile(tmp_path / "a.mp4", 100, 80, 5) as video:
            video.add(png("white", 50, 200, mode))
            video.add(Image.new(mode, (300, 30)))
        first, second = decoded(tmp_path / "a.mp4")
        assert first.size == second.size == (100, 80)
        assert near(first, (20, 40), "white")
        assert near(second, (90, 10), "black") and near(second, (50, 60), "white")


def test_bad_videos_are_named(tmp_path: Path) -> None:
    (tmp_path / "folder.mp4").mkdir()
    for name, size, fps, reason in (
        *((name, (64, 64), 10, "ends with .mp4") for name in ("a.gif", ".")),
        ("no/a.mp4", (64, 64), 10, "No such file"),
        ("folder.mp4", (64, 64), 10, "Is a directory"),
        ("a.mp4", (1, 64), 10, "1 x 64 is not"),
        ("a.mp4", (64, 10_000), 10, "64 x 10000 is not"),
        *(("a.mp4", (64, 64), fps, f"{fps} is not") for fps in (0, 1000)),
    ):
        with pytest.raises(OutputError, match=reason):
            VideoFile(tmp_path / name, *size, fps)
