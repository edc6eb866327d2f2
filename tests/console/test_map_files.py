"""Map files of browsers: uploads of each format, and downloads with what they lose."""

from __future__ import annotations

import base64
import io
import zipfile
from pathlib import Path

import pytest
from PIL import Image

from robocorba.console.map_files import FORMATS, InvalidUpload, read_upload, write_download
from robocorba.errors.maps import MapFileError
from robocorba.maps import native
from robocorba.maps.formats import WRITTEN
from robocorba.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.testing.buildings import two_floors


def packed(content: str | bytes) -> str:
    return base64.b64encode(content.encode() if isinstance(content, str) else content).decode()


def upload(files: dict[str, str]) -> dict[str, object]:
    return read_upload(files, "blocked", "walls", False, SMARTPAL_RADIUS_M)


def test_every_format_that_is_known_is_offered() -> None:
    assert set(FORMATS) == set(WRITTEN)


def test_a_native_map_comes_back_unchanged() -> None:
    download = write_download(two_floors(), "native", 0.05, "pgm")
    assert (download["name"], download["losses"]) == ("two_floors.yaml", [])
    answer = upload({"house.yaml": download["content"]})
    assert native.loads(str(answer["document"])) == two_floors()
    assert (answer["format"], answer["losses"]) == ("native", [])


@pytest.mark.parametrize("format", ["openrmf", "ros", "nav2"])
def test_a_foreign_format_names_its_losses(format: str) -> None:
    assert write_download(two_floors(), format, 0.2, "png")["losses"]


def test_ros_maps_are_an_archive_that_can_be_read_again() -> None:
    download = write_download(two_floors(), "ros", 0.2, "png")
    with zipfile.ZipFile(io.BytesIO(base64.b64decode(download["content"]))) as archive:
        files = {name: packed(archive.read(name)) for name in archive.namelist() if "L1" in name}
    answer = upload(files)
    assert answer["format"] == "ros"


def test_an_error_names_the_file_and_its_line_but_no_folder() -> None:
    with pytest.raises(MapFileError) as refused:
        upload({"C:\\maps\\house.yaml": packed("robocorba: 1\nname: x\nfloors: [{name: 1}]\n")})
    assert (refused.value.file, refused.value.line > 0) == ("house.yaml", True)
    assert "/" not in str(refused.value)


ROS_MAP = "image: {image}\nresolution: 0.1\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.2\nnegate: 0\n"
ROS_LIST = "ros_maps: 1\nname: x\nfloors: [{{name: L1, level: 0, map: {map}}}]\n"


def outside(folder: Path) -> Path:
    """A picture on the console's host."""
    picture = folder / "private.png"
    Image.new("L", (40, 40), 254).save(picture)
    return picture


@pytest.mark.parametrize("path", ["{}", "/../{}", "../../../../../../../../{}"])
def test_uploads_can_not_name_pictures_of_the_host(path: str, tmp_path: Path) -> None:
    named = path.format(outside(tmp_path))
    with pytest.raises(MapFileError, match="a picture must lie in the folder of the file or below, not at") as refused:
        upload({"map.yaml": packed(ROS_MAP.format(image=named))})
    assert (refused.value.file, refused.value.key) == ("map.yaml", "image")
    assert named in str(refused.value)


def test_uploads_can_not_name_maps_of_the_host(tmp_path: Path) -> None:
    file = tmp_path / "map.yaml"
    file.write_text(ROS_MAP.format(image=outside(tmp_path).name))
    with pytest.raises(MapFileError, match="a map_server file must lie in the folder") as refused:
        upload({"house.yaml": packed(ROS_LIST.format(map=file))})
    assert refused.value.file == "house.yaml"
    with pytest.raises(MapFileError, match="a picture must lie in the folder"):
        upload(
            {
                "house.yaml": packed(ROS_LIST.format(map="map.yaml")),
                "map.yaml": packed(ROS_MAP.format(image=outside(tmp_path))),
            }
        )


@pytest.mark.parametrize(
    "files",
    [
        {},
        {"picture.png": packed(b"\x89PNG")},
        {"a.yaml": "no base64!"},
        {"..": packed("x")},
        {"a.yaml": packed("a: 1"), "b.yaml": packed("b: 1")},
        {"n\0.yaml": packed("a: 1")},
        {"x" * 300 + ".yaml": packed("a: 1")},
    ],
)
def test_what_is_no_map_is_refused(files: dict[str, str]) -> None:
    with pytest.raises(InvalidUpload):
        upload(files)


def test_an_option_that_is_refused_names_the_file_but_no_folder() -> None:
    with pytest.raises(MapFileError) as refused:
        write_download(two_floors(), "ros", 0.05, "gif")
    assert refused.value.file == "two_floors.yaml"


def test_an_unknown_format_is_refused() -> None:
    with pytest.raises(InvalidUpload):
        write_download(two_floors(), "dwg", 0.05, "pgm")
