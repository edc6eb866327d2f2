"""Operations of the map page: edit the building, plan paths, import and export."""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Any

from robocorba.console import map_files
from robocorba.console.arguments import InvalidArguments, number, text
from robocorba.console.map_edits import Edit, apply_edits, read_edits, stale_of
from robocorba.console.map_sessions import TabSession, TabSessions
from robocorba.errors.maps import DuplicateElement, InvalidElement, MapError, SessionEnded, VersionUnavailable
from robocorba.errors.paths import PathError
from robocorba.map_editor.corba.remote_edit_session import RemoteMapEditor
from robocorba.map_editor.edits import Finding
from robocorba.map_editor.element_json import as_json, form_members
from robocorba.map_editor.model import COLLECTION_OF, ElementKind
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.map_editor.underlays import Underlay
from robocorba.orb.orb import Orb
from robocorba.planning.corba.remote_planner import RemotePlanner
from robocorba.planning.request import Path, PathRequest, Place, RouteMode

#: Maximum number of edits and findings in an answer.
MAX_NEWS, MAX_FINDINGS = 50, 500
Answer = dict[str, Any]
_NEW_SESSION = "the map editor had ended the session of this page; earlier edits can't be undone any more"


class MapOperations:
    """Operations of the map page: edit the building, plan paths, import and export."""

    def __init__(self, orb: Orb, editor: RemoteMapEditor | None = None) -> None:
        self._editor, self._planner = editor or RemoteMapEditor(orb), RemotePlanner(orb)
        self._sessions = TabSessions(self._editor)

    # ---- reading ----

    def map_forms(self) -> Answer:
        """The members of each kind of element, for forms."""
        return {kind.value: form_members(kind) for kind in ElementKind}

    def map_floor(self, floor: str) -> Answer:
        """`floors` and `elevators` of the building and the other `elements` of a floor (none of them if it does not
        exist), each with `kind`, `floor`, `name`, `version` and `members`; and the `version` of the building, which is
        not newer than any of them."""
        version = self._editor.version()
        floors = self._editor.elements(ElementKind.FLOOR)
        found = [(kind, "", *each) for kind in (ElementKind.ELEVATOR,) for each in self._editor.elements(kind)]
        if any(element.name == floor for element, _ in floors):
            found += [(kind, floor, *each) for kind in COLLECTION_OF for each in self._editor.elements(kind, floor)]
        rows = [(ElementKind.FLOOR, "", *each) for each in floors] + found
        elements = [
            {"kind": kind.value, "floor": on, "name": element.name, "version": at, "members": as_json(element)}
            for kind, on, element, at in rows
        ]
        return {"version": version, "building": self._editor.building_name(), "elements": elements}

    # ---- editing ----

    def map_open(self, author: str) -> Answer:
        """Begin a session of this author: its key and the version of the building."""
        return {"session": self._sessions.open(author.strip()), "version": self._editor.version()}

    def map_close(self, session: str) -> None:
        """End a session; its edits stay."""
        self._sessions.close(session)

    def map_edit(self, session: str, edits: list[Any]) -> Answer:
        """Make edits as one step for undo, with what has to change with them.

        Each has `do` (create, change, remove, rename), `kind`, `floor`, `name`, but for create `version`, for create
        and change `members`, for rename, which stands alone, `to`. The answer has the new `version`, or `refused`: the
        `reason`, `problems` (each with kind, floor, name, x, y, reason), whether a name is `taken`, and, if somebody
        else has changed an element meanwhile, `stale` (its kind, floor and name)."""
        wanted = read_edits(edits)
        return self._in_session(session, lambda tab: self._edit(tab, wanted))

    def _edit(self, tab: TabSession, edits: list[Edit]) -> int:
        if [edit.do for edit in edits] == ["rename"]:
            one = edits[0]
            version: int = tab.remote.rename(one.kind, one.floor, one.name, one.to, one.version)
            return version
        return apply_edits(self._editor, tab.remote, edits)

    def map_undo(self, session: str) -> Answer:
        """Undo the last edit of this session. Answers as `map_edit`."""
        return self._in_session(session, lambda tab: int(tab.remote.undo()))

    def map_redo(self, session: str) -> Answer:
        """Redo what this session has undone last. Answers as `map_edit`."""
        return self._in_session(session, lambda tab: int(tab.remote.redo()))

    def map_news(self, session: str, since: int) -> Answer:
        """What happened after version `since`: `edits`, the newest MAX_NEWS (version, author, summary, changes), or
        None if they are not kept; `version`, and what this session can undo and redo."""
        tab = self._sessions.find(session)
        try:
            edits: list[Answer] | None = [
                {"version": one.version, "author": one.author, "summary": one.summary, "changes": one.changes}
                for one in self._editor.edits_since(since)[-MAX_NEWS:]
            ]
        except VersionUnavailable:
            edits = None
        with tab.lock:
            try:
                undoable, redoable, note = tab.remote.undoable(), tab.remote.redoable(), ""
            except SessionEnded:
                self._sessions.renew(tab)
                undoable, redoable, note = "", "", _NEW_SESSION
        version = self._editor.version()
        return {"version": version, "edits": edits, "undoable": undoable, "redoable": redoable, "note": note}

    # ---- what robots have seen ----

    def map_proposals(self) -> list[Answer]:
        """What robots have seen and the map lacks: `name`, `floor`, `outline`, its middle `x`, `y` [m], `certainty`,
        `seen_by`."""
        return [
            {
                **{"name": one.name, "floor": one.floor, "outline": one.outline, "certainty": one.certainty},
                **{"x": one.element.at[0], "y": one.element.at[1], "seen_by": one.seen_by},
            }
            for one in self._editor.proposals()
        ]

    def map_accept(self, session: str, name: str) -> Answer:
        """Draw what a proposal offers, as an edit of this session. Answers as `map_edit`."""
        return self._in_session(session, lambda tab: int(tab.remote.accept_proposal(name)))

    def map_reject(self, name: str) -> None:
        """Close a proposal: it is not proposed again while robots see it."""
        self._editor.reject_proposal(name)

    def _in_session(self, session: str, edit: Callable[[TabSession], int]) -> Answer:
        tab, note = self._sessions.find(session), ""
        with tab.lock:
            try:
                try:
                    version = edit(tab)
                except SessionEnded:  # nothing was edited
                    self._sessions.renew(tab)
                    version, note = edit(tab), _NEW_SESSION
            except MapError as error:
                is_taken = isinstance(error, DuplicateElement)
                return {
                    "refused": {"reason": str(error), **_places(error), "stale": stale_of(error), "taken": is_taken}
                }
        return {"version": version, "note": note}

    def map_build_roads(self, floor: str, radius: float) -> int:
        """Replace nodes and edges of a floor by generated ones for robots of a radius [m]. Returns the version."""
        return self._editor.build_topological_map(floor, radius)

    def map_undo_whole(self, version: int) -> int:
        """Undo the last edit, of generated roads or of the whole building, if it made this version. Returns the new
        one."""
        return self._editor.undo(version)

    # ---- checking and planning ----

    def map_check(self, floor: str, radius: float) -> Answer:
        """What keeps a robot of a radius [m] from parts of a floor, or of the building if `floor` is empty: `findings`
        (kind, floor, name, x, y, reason) of `version`, and how many there are in all."""
        version = self._editor.version()
        found = self._editor.check_floor(floor, radius) if floor else self._editor.check()
        return {
            "version": version,
            "count": len(found),
            "findings": [finding_json(one) for one in found[:MAX_FINDINGS]],
        }

    def map_paths(self, start: Answer, goal: Answer, radius: float = SMARTPAL_RADIUS_M) -> list[Answer]:
        """A path in each mode: `mode` with `points`, `length` [m] and `seconds`, or with `reason` why there is none.

        start, goal: `floor`, `x`, `y` [m]."""
        begin, end = _place("start", start), _place("goal", goal)
        answers = []
        for mode in (RouteMode.SMOOTHED, RouteMode.TOPOLOGICAL, RouteMode.GEOMETRIC):
            answer: Answer = {"mode": mode.name.lower()}
            try:
                found = self._planner.paths(PathRequest(begin, end, radius=radius, mode=mode))[0]
                answer.update(length=found.distance, seconds=found.duration, points=_points(found))
            except PathError as error:
                answer["reason"] = str(error)
            answers.append(answer)
        return answers

    # ---- files ----

    def map_formats(self) -> list[Answer]:
        """The formats of `map_export`: `name`, `title`, and whether they consist of `cells`."""
        return map_files.downloads()

    def map_export(self, format: str, resolution: float = 0.05, image: str = "pgm") -> Answer:
        """The building as a file: `name`, `content` in base64, `losses`. resolution [m], image (pgm, png): for ros."""
        building, _ = self._editor.building()
        return map_files.write_download(building, format, resolution, image)

    def map_read_files(
        self,
        files: dict[str, str],
        unknown: str = "blocked",
        specks: str = "walls",
        topology: bool = False,
        radius: float = SMARTPAL_RADIUS_M,
    ) -> Answer:
        """What uploaded map files hold; nothing is changed. Answers as read_upload of map_files."""
        return map_files.read_upload(files, unknown, specks, topology, radius)

    def map_replace(self, document: str, version: int) -> int:
        """Replace the whole building by a native map file's. version: of the building that it replaces."""
        return self._editor.import_map(document, version)

    def map_underlay(self, floor: str) -> Answer | None:
        """The picture below a floor: `picture` in base64, `x`, `y` of its lower left corner and `resolution` [m]."""
        found = self._editor.underlay(floor)
        if found is None:
            return None
        picture = base64.b64encode(found.picture).decode()
        return {"picture": picture, "x": found.origin[0], "y": found.origin[1], "resolution": found.resolution}

    def map_set_underlay(
        self, floor: str, picture: str | None = None, x: float = 0.0, y: float = 0.0, resolution: float = 0.05
    ) -> None:
        """Place a picture (PNG or JPEG in base64) below a floor; without a picture, remove it."""
        underlay = None
        if picture:
            underlay = Underlay(map_files.decoded(picture, "the picture"), (x, y), resolution)
        self._editor.set_underlay(floor, underlay)


def finding_json(finding: Finding) -> Answer:
    """A finding as a JSON object."""
    floor, x, y = finding.where
    return {
        **{"kind": finding.kind.value, "floor": finding.floor or floor, "name": finding.name},
        **{"x": x, "y": y, "reason": finding.reason},
    }


def _places(error: MapError) -> Answer:
    problems = [finding_json(one) for one in getattr(error, "problems", ())]
    if not problems and isinstance(error, InvalidElement):
        problems = [{"kind": error.kind, "floor": error.floor, "name": error.name, "reason": error.reason}]
    return {"problems": problems[:MAX_FINDINGS]}


def _points(path: Path) -> list[Answer]:
    return [
        {
            **{"kind": point.kind.name.lower(), "floor": point.floor, "x": point.x, "y": point.y},
            **{"node": point.node, "elevator": point.elevator},
        }
        for point in path.points
    ]


def _place(what: str, value: Any) -> Place:
    try:
        return Place(text("floor", value["floor"]), number("x", value["x"]), number("y", value["y"]))
    except (KeyError, TypeError):
        raise InvalidArguments(f"{what} is not an object with floor, x and y") from None
