"""The map page: its operations on a building editor in this process, its sessions, and its files."""

from __future__ import annotations

import base64
import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest
from PIL import Image

from robocorba.console.arguments import InvalidArguments, NotPossible
from robocorba.console.map_files import downloads, read_upload, write_download
from robocorba.console.map_operations import MapOperations
from robocorba.console.map_sessions import MAX_SESSIONS, TabSessions
from robocorba.errors.maps import InvalidElement, MapFileError, SessionEnded, UnknownElement
from robocorba.map_editor import native
from robocorba.map_editor.edit_session import EditSessions
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import Building, ElementKind
from robocorba.map_editor.proposals import Proposals
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.map_editor.store import MapStore
from robocorba.map_editor.validation import problems
from testkit.buildings import two_floors


class LocalEditor:
    """A building editor with the methods of RemoteMapEditor that edits need."""

    def __init__(self, editor: BuildingEditor) -> None:
        self.editor, self.sessions = editor, list[LocalSession]()
        self.elements, self.edits_since = editor.elements, editor.edits_since
        self.offered = Proposals(editor.snapshot)
        editor.subscribe(self.offered.follow)
        self.proposals, self.reject_proposal = self.offered.open, self.offered.reject

    def version(self) -> int:
        return self.editor.version

    def building_name(self) -> str:
        return self.editor.building.name

    def building(self) -> tuple[Building, int]:
        return self.editor.snapshot

    def open_session(self, author: str) -> LocalSession:
        self.sessions.append(LocalSession(EditSessions(self.editor).open(author), self.offered))
        return self.sessions[-1]


class LocalSession:
    """The methods of RemoteEditSession."""

    def __init__(self, session: Any, offered: Proposals) -> None:
        self._session, self._offered, self.is_closed = session, offered, False

    def accept_proposal(self, name: str) -> int:
        proposal = self._offered.find(name)
        version: int = self.create(proposal.floor, proposal.element)
        return version

    def __getattr__(self, name: str) -> Any:
        if self.is_closed:
            raise SessionEnded("the edit session has ended")
        value = getattr(self._session, name)
        return (lambda: value) if isinstance(value, str) else value

    def close(self) -> None:
        self.is_closed = True


Edit = dict[str, Any]


@pytest.fixture
def editor(tmp_path: Path) -> Iterator[LocalEditor]:
    with MapStore.create(tmp_path / "map.sqlite", two_floors()) as store:
        yield LocalEditor(BuildingEditor(store))


@pytest.fixture
def page(editor: LocalEditor) -> Page:
    return Page(editor)


class Page:
    """A tab of the map page."""

    def __init__(self, editor: LocalEditor, author: str = "A.", operations: MapOperations | None = None) -> None:
        self.editor = editor
        self.operations = operations or MapOperations(cast(Any, None), cast(Any, editor))
        self.session = self.operations.map_open(author)["session"]

    @property
    def building(self) -> Building:
        return self.editor.editor.building

    def record(self, kind: str, name: str, floor: str = "L1") -> Edit:
        elements = self.operations.map_floor(floor)["elements"]
        return next(dict(each) for each in elements if (each["kind"], each["name"]) == (kind, name))

    def edit(self, *edits: Edit) -> Edit:
        return self.operations.map_edit(self.session, list(edits))

    def change(self, kind: str, name: str, floor: str = "L1", **members: Any) -> Edit:
        record = self.record(kind, name, floor)
        return {**record, "do": "change", "members": {**record["members"], **members}}

    def remove(self, kind: str, name: str, floor: str = "L1") -> Edit:
        return {**self.record(kind, name, floor), "do": "remove"}


def created(kind: str, name: str, floor: str = "", **members: Any) -> Edit:
    return {"do": "create", "kind": kind, "floor": floor, "name": name, "members": {"name": name, **members}}


def wall(name: str, *ends: tuple[float, float]) -> Edit:
    return created("wall", name, "L1", **{"from": ends[0], "to": ends[1]})


def test_what_robots_have_seen_is_accepted_or_rejected(page: Page) -> None:
    corners = ((3.0, 5.0), (3.5, 5.0), (3.5, 5.5), (3.0, 5.5))
    chair, box = (page.editor.offered.propose("L1", [(x + dx, y) for x, y in corners], 0.9, "A") for dx in (0.0, 3.0))
    first, second = page.operations.map_proposals()
    assert (first["name"], first["floor"], first["seen_by"], first["certainty"]) == (chair, "L1", ("A",), 0.9)
    assert (first["x"], first["y"]) == pytest.approx((3.25, 5.25)) and sorted(first["outline"]) == sorted(corners)
    page.operations.map_reject(box)
    with pytest.raises(UnknownElement, match=f"no object '{box}'"):
        page.operations.map_reject(box)
    answer = page.operations.map_accept(page.session, chair)
    assert page.record("object", chair)["version"] == answer["version"]
    assert page.operations.map_news(page.session, 1)["undoable"] == f"object {chair} on L1 created"
    assert page.operations.map_proposals() == []
    assert "no object" in page.operations.map_accept(page.session, second["name"])["refused"]["reason"]


def test_a_floor_has_its_elements_and_paths_lead_between_places(page: Page) -> None:
    answer = page.operations.map_floor("L2")
    found = {(each["kind"], each["floor"], each["name"]) for each in answer["elements"]}
    assert found >= {("floor", "", "L1"), ("floor", "", "L2"), ("elevator", "", "E1"), ("node", "L2", "lift2")}
    assert not [key for key in found if key[1] == "L1"]
    assert (answer["version"], answer["building"]) == (page.editor.version(), "two floors")
    assert {each["kind"] for each in page.operations.map_floor("attic")["elements"]} == {"floor", "elevator"}
    start = {"floor": "L1", "x": 1, "y": 1}
    for wrong in (
        *(None, [], {"floor": "L1", "x": 1}, {"floor": 3, "x": 1, "y": 1}, {"x": 1, "y": 1}),
        *({**start, "x": x} for x in ("1", None, float("nan"), 10**400)),
    ):
        with pytest.raises(InvalidArguments):
            page.operations.map_paths(start, wrong)  # type: ignore[arg-type]


def test_edits_together_are_one_step_for_undo(page: Page) -> None:
    before = page.building
    assert "refused" in page.operations.map_undo(page.session)
    answer = page.edit(wall("a", (1, 1), (2, 1)), wall("b", (2, 1), (2, 2)))
    assert answer["version"] == page.editor.version()
    assert page.building.find(ElementKind.WALL, "L1", "b")
    news = page.operations.map_news(page.session, answer["version"] - 1)
    assert [(edit["author"], edit["changes"]) for edit in news["edits"]] == [("A.", 2)]
    assert news["undoable"]
    page.operations.map_undo(page.session)
    assert page.building == before
    page.operations.map_redo(page.session)
    assert page.building.find(ElementKind.WALL, "L1", "a")


def test_edges_follow_their_nodes_and_a_node_in_a_cabin_is_kept(page: Page) -> None:
    refused = page.edit(page.remove("node", "lift1"))["refused"]
    assert "elevator 'E1' stops at it" in refused["reason"]
    assert page.building.find(ElementKind.NODE, "L1", "lift1")
    assert "version" in page.edit({**page.record("node", "east"), "do": "rename", "to": "<b>e</b>"})
    assert page.building.floors["L1"].topological.edges["west-east"].b == "<b>e</b>"
    assert "version" in page.edit(page.remove("node", "<b>e</b>"), page.change("elevator", "E1", at=[17.9, 5.0]))
    assert not page.building.floors["L1"].topological.edges
    assert page.building.floors["L2"].topological.nodes["lift2"].at == pytest.approx((17.9, 5.0))
    assert problems(page.building) == []


def test_what_refuses_an_edit_is_named(page: Page, editor: LocalEditor) -> None:
    refused = page.edit(wall("w", (1, 1), (2, 1)))["refused"]
    assert (refused["taken"], refused["stale"]) == (True, None)
    refused = page.edit(*(created("node", name, "L1", at=[10.0, y]) for name, y in (("p", 1.0), ("q", 2.0))))["refused"]
    assert [(one["name"], one["x"], one["y"]) for one in refused["problems"]] == [("p", 10.0, 1.0), ("q", 10.0, 2.0)]
    assert page.building == two_floors()
    late = page.change("wall", "w", height=3.0)
    Page(editor, "B.", page.operations).edit(page.change("wall", "w", height=2.0))
    assert page.edit(late)["refused"]["stale"] == {"kind": "wall", "floor": "L1", "name": "w"}
    Page(editor, "B.", page.operations).edit(page.remove("wall", "w"))
    assert page.edit(late)["refused"]["stale"]["name"] == "w"


REMOVE = {"do": "remove", "kind": "wall", "floor": "L1", "name": "w"}


@pytest.mark.parametrize(
    "edits",
    [
        *(None, [], ["remove"], [{"do": "remove"}]),
        *([{**REMOVE, **wrong}] for wrong in ({"do": "paint"}, {"kind": "roof", "version": 1})),
        *([{**REMOVE, "version": version}] for version in ("new", float("inf"), 10**400)),
        *([{**REMOVE, "version": 1, **wrong}] for wrong in ({"floor": "L1\0"}, {"name": "\ud800"})),
        [{**wall("a", (0, 1), (1, 1)), "name": "b"}],
    ],
)
def test_other_requests_are_refused(page: Page, edits: Any) -> None:
    with pytest.raises((InvalidElement, InvalidArguments)):
        page.operations.map_edit(page.session, edits)


def test_a_session_that_the_map_editor_has_ended_is_replaced(page: Page, editor: LocalEditor) -> None:
    editor.sessions[-1].is_closed = True
    answer = page.edit(wall("a", (1, 1), (2, 1)))
    assert "can't be undone any more" in answer["note"]
    assert page.building.find(ElementKind.WALL, "L1", "a")
    for _ in range(2):
        page.operations.map_close(page.session)
    assert editor.sessions[-1].is_closed
    with pytest.raises(NotPossible):
        page.edit(wall("b", (1, 1), (2, 1)))


def test_the_one_that_is_silent_for_longest_makes_place(editor: LocalEditor) -> None:
    sessions = TabSessions(cast(Any, editor))
    busy, silent = sessions.open("B."), sessions.open("A.")
    sessions.find(busy)
    for _ in range(MAX_SESSIONS - 1):
        sessions.open("A.")
    assert [session.is_closed for session in editor.sessions] == [False, True] + [False] * (MAX_SESSIONS - 1)
    assert sessions.find(busy).author == "B."
    with pytest.raises(NotPossible):
        sessions.find(silent)


def packed(content: str | bytes) -> str:
    return base64.b64encode(content.encode() if isinstance(content, str) else content).decode()


def upload(files: dict[str, str]) -> dict[str, object]:
    return read_upload(files, "blocked", "walls", False, SMARTPAL_RADIUS_M)


def test_uploads_and_downloads() -> None:
    assert {each["name"] for each in downloads() if each["cells"]} == {"ros"}
    download = write_download(two_floors(), "native", 0.05, "pgm")
    assert (download["name"], download["losses"]) == ("two_floors.yaml", [])
    answer = upload({"house.yaml": download["content"]})
    assert native.loads(str(answer["document"])) == two_floors()
    assert (answer["format"], answer["losses"]) == ("native", [])
    for foreign in ("openrmf", "ros", "nav2"):
        assert write_download(two_floors(), foreign, 0.2, "png")["losses"]
    download = write_download(two_floors(), "ros", 0.2, "png")
    with zipfile.ZipFile(io.BytesIO(base64.b64decode(download["content"]))) as archive:
        files = {name: packed(archive.read(name)) for name in archive.namelist() if "L1" in name}
    assert upload(files)["format"] == "ros"
    with pytest.raises(MapFileError) as refused:
        upload({"C:\\maps\\house.yaml": packed("robocorba: 1\nname: x\nfloors: [{name: 1}]\n")})
    assert (refused.value.file, refused.value.line > 0) == ("house.yaml", True)
    assert "/" not in str(refused.value)
    with pytest.raises(MapFileError) as refused:
        write_download(two_floors(), "ros", 0.05, "gif")
    assert refused.value.file == "two_floors.yaml"
    with pytest.raises(InvalidArguments):
        write_download(two_floors(), "dwg", 0.05, "pgm")


ROS_MAP = "image: {image}\nresolution: 0.1\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.2\nnegate: 0\n"
ROS_LIST = "ros_maps: 1\nname: x\nfloors: [{{name: L1, level: 0, map: {map}}}]\n"


def test_uploads_can_not_name_pictures_and_maps_of_the_host(tmp_path: Path) -> None:
    file, picture = tmp_path / "map.yaml", tmp_path / "private.png"
    Image.new("L", (40, 40), 254).save(picture)
    for path in ("{}", "/../{}", "../../../../../../../../{}"):
        named = path.format(picture)
        inside = pytest.raises(MapFileError, match="a picture must lie in the folder of the file or below, not at")
        with inside as refused:
            upload({"map.yaml": packed(ROS_MAP.format(image=named))})
        assert (refused.value.file, refused.value.key) == ("map.yaml", "image")
        assert named in str(refused.value)
    file.write_text(ROS_MAP.format(image=picture.name))
    with pytest.raises(MapFileError, match="a map_server file must lie in the folder") as refused:
        upload({"house.yaml": packed(ROS_LIST.format(map=file))})
    assert refused.value.file == "house.yaml"
    house, own = packed(ROS_LIST.format(map="map.yaml")), packed(ROS_MAP.format(image=picture))
    with pytest.raises(MapFileError, match="a picture must lie in the folder"):
        upload({"house.yaml": house, "map.yaml": own})


def test_what_is_no_map_is_refused() -> None:
    one, two = packed("a: 1"), packed("b: 1")
    for files in (
        *({}, {"picture.png": packed(b"\x89PNG")}, {"a.yaml": "no base64!"}, {"..": packed("x")}),
        *({"a.yaml": one, "b.yaml": two}, {"n\0.yaml": one}, {"x" * 300 + ".yaml": one}),
    ):
        with pytest.raises(InvalidArguments):
            upload(files)
