"""What robots of two sub-networks see and no map has: correlated, proposed, planned around, drawn or rejected."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence

import msgspec
import pytest
from shapely import LineString, Point, Polygon

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.maps import UnknownElement
from robocorba.events.corba.event_client import EventClient
from robocorba.map_editor.corba.remote_edit_session import RemoteMapEditor
from robocorba.map_editor.model import ElementKind, MapObject
from robocorba.map_editor.proposals import Proposal
from robocorba.map_editor.samples import sample_path
from robocorba.map_editor.sightings import SeenObstacle
from robocorba.map_editor.spatial.pose import XY
from robocorba.missions.corba.remote_world import RemoteWorld
from robocorba.orb.orb import Orb
from robocorba.planning.corba.remote_planner import RemotePlanner
from robocorba.planning.request import PathRequest, Place
from robocorba.robot.sightings import INTERVAL_S, SightingReport
from robocorba.stubs import RoboCorba__POA
from robocorba.system.names import ROBOTS, SIGHTING_EVENT
from robocorba.system.repeating import Repeating
from testkit.processes import Launcher, Running, eventually, read_json

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

#: Half the side of a chair [m], and where it stands: on the way from place-B to the destination.
HALF_M, CHAIR = 0.25, (6.0, 2.2)
START, GOAL = Place("L1", 5.2, 1.2), Place("L1", 6.7, 3.1)
LIMIT_S = 60.0


def side(at: XY, *corners: tuple[int, int]) -> SeenObstacle:
    """What a robot sees of a chair: these corners."""
    outline = tuple((at[0] + HALF_M * x, at[1] + HALF_M * y) for x, y in corners)
    return SeenObstacle(1, "L1", *at, outline, 0.8)


def from_west(at: XY) -> SeenObstacle:
    return side(at, (-1, -1), (-1, 1), (1, 1))


def from_east(at: XY) -> SeenObstacle:
    return side(at, (1, 1), (1, -1), (-1, -1))


class Watchers:
    """Robots A, C and E, which publish what they see, each at the channel of its sub-network."""

    def __init__(self, orb: Orb, stack: contextlib.ExitStack) -> None:
        self._orb, self._stack = orb, stack
        orb.serve({f"{ROBOTS}/{name}": RoboCorba__POA.RobotAgent() for name in "ACE"})
        self.sights: dict[str, list[SeenObstacle]] = {}

    def start(self, name: str, channel: str) -> None:
        client = self._stack.enter_context(EventClient(self._orb, channel, name))
        sights = self.sights[name] = []
        report = SightingReport(
            lambda: sights,
            lambda event: client.push(SIGHTING_EVENT, msgspec.to_builtins(event), expiry_s=10.0, retry_s=0.0),
        )
        self._stack.callback(Repeating(name, report.update, INTERVAL_S).start().close)


def test_what_two_robots_see_is_proposed_planned_around_and_accepted(
    robocorba_up: Callable[..., Running], client: Orb
) -> None:
    """By a person, or by a rule where a third robot sees it, too."""
    running = robocorba_up("--building", str(sample_path("paper-scene")), "--accept", "3,1").wait_ready()
    with contextlib.ExitStack() as stack:
        propose(running, client, Watchers(client, stack))
    assert running.stop() == 0


def propose(running: Running, client: Orb, watchers: Watchers) -> None:
    editor, planner = RemoteMapEditor(client), RemotePlanner(client)

    def path() -> list[XY]:
        found = planner.paths(PathRequest(START, GOAL))[0]
        return [(point.x, point.y) for point in found.points]

    def clearance_m(at: XY) -> float:
        outline = Polygon([(at[0] + HALF_M * x, at[1] + HALF_M * y) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        return LineString(path()).distance(outline)

    def proposals() -> Sequence[Proposal]:
        with contextlib.suppress(RoboCorbaError):  # while the map editor is started again
            return editor.proposals()
        return ()

    straight = path()
    assert clearance_m(CHAIR) < 0.4
    watchers.start("A", "lab")
    watchers.sights["A"].append(from_west(CHAIR))
    time_alone = time.monotonic()
    watchers.start("C", "hall")
    eventually(lambda: time.monotonic() - time_alone > 5.0, what="A sees it alone for a while")
    assert proposals() == []
    watchers.sights["C"].append(from_east(CHAIR))
    eventually(lambda: len(proposals()) == 1, LIMIT_S, "the proposal")
    (proposal,) = proposals()
    assert (proposal.floor, proposal.seen_by) == ("L1", ("A", "C"))
    assert proposal.certainty == pytest.approx(0.96)
    assert proposal.element.at == pytest.approx(CHAIR, abs=0.05)
    assert clearance_m(CHAIR) >= 0.4
    in_carries_way = {each.name: each.geometry for each in RemoteWorld(client).others("table")["L1"]}
    assert in_carries_way[proposal.name].distance(Point(CHAIR)) == 0.0
    assert editor.elements(ElementKind.OBJECT, "L1")[-1][0].name != proposal.name  # on no map yet

    # A second one, which a person rejects; the first one is accepted after a kill of the map editor.
    watchers.sights["A"].append(msgspec.structs.replace(from_west((3.0, 5.5)), number=2))
    watchers.sights["C"].append(msgspec.structs.replace(from_east((3.0, 5.5)), number=2))
    eventually(lambda: len(proposals()) == 2, LIMIT_S, "the second proposal")
    second = next(each.name for each in proposals() if each.name != proposal.name)
    editor.reject_proposal(second)
    with pytest.raises(UnknownElement):
        editor.reject_proposal(second)
    watchers.sights["A"].clear()
    watchers.sights["C"].clear()
    before = running.pid("map_editor")
    os.kill(before, signal.SIGKILL)  # at once: what was answered is kept
    eventually(lambda: running.pid("map_editor") not in (0, before), LIMIT_S, "started again")
    eventually(lambda: [each.name for each in proposals()] == [proposal.name], LIMIT_S, "the proposal again")
    assert clearance_m(CHAIR) >= 0.4
    session = editor.open_session("Ada")
    version = session.accept_proposal(proposal.name)
    element, changed_at = editor.read(ElementKind.OBJECT, "L1", proposal.name)
    assert isinstance(element, MapObject) and changed_at == version
    assert element.at == pytest.approx(CHAIR, abs=0.05)
    assert [edit.author for edit in editor.edits_since(version - 1)] == ["Ada"]
    assert proposals() == []
    assert clearance_m(CHAIR) >= 0.4
    session.undo()
    eventually(lambda: path() == straight, LIMIT_S, "the path as before")

    watchers.start("E", "hall")
    for name, seen in (("A", from_west(CHAIR)), ("C", from_east(CHAIR)), ("E", from_east(CHAIR))):
        watchers.sights[name].append(seen)
    (edit,) = eventually(lambda: editor.edits_since(version + 1), LIMIT_S, "the edit by the rule")
    assert edit.author == "rule: 3 robots" and edit.summary.startswith("object seen ")
    assert proposals() == []


def test_the_demo_of_perception_finds_the_chair(launch: Launcher) -> None:
    """In time, where the machine is not busy: its exit code says that, too."""
    demo = launch(sys.executable, "-m", "robocorba.clients.perception_demo", "found")
    printed, errors = demo.communicate(timeout=600)
    assert "path from A's lookout to C's: 2.8" in printed and "accepted: seen 1" in printed, printed + errors
    found = read_json((launch.folder / "found" / "perception.json").read_text())
    assert set(found["seen_s"]) == {"A", "B", "C"}
    assert found["off_m"] <= 0.05 and found["certainty"] > 0.9
    assert demo.returncode == (found["after_s"] > 10.0)
    for picture in ("proposed.png", "accepted.png"):
        assert (launch.folder / "found" / picture).stat().st_size > 10_000
