"""The map editor server: the map building agent and the path planning agent on one building."""

from __future__ import annotations

import gc
from collections.abc import Sequence
from contextlib import closing

from robocorba.map_editor.corba.map_editor_servant import MapEditorServant
from robocorba.map_editor.edit_session import EditSessions
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import Building
from robocorba.orb.call_limit import CallLimit
from robocorba.orb.orb import Orb
from robocorba.planning.corba.path_planner_servant import PathPlannerServant
from robocorba.planning.planner import PathPlanner
from robocorba.servers.initial_building import open_store
from robocorba.system import logs
from robocorba.system.private_files import claim_state
from robocorba.system.record_file import KEEP_INTERVAL_S
from robocorba.system.repeating import Repeating
from robocorba.system.settings import ServerSettings

#: Maximum numbers of calls that the map editor executes at the same time: those that read elements, and those that go
#: through a whole floor or building. Edits, and followers of changes, don't wait for them.
READING, ANALYSING = 4, 2
#: Size of what forgotten transactions held beyond which it is worth while to search for free memory.
LARGE = 10_000


def preload() -> None:
    """Compile or load the kernels."""
    PathPlanner(Building("none")).warm_up()


def keep(sessions: EditSessions) -> None:
    """Write the building's file again if it was removed, and end what clients have forgotten."""
    sessions.editor.keep_stored()
    sessions.end_idle()
    if sessions.editor.end_idle() > LARGE:
        gc.collect()  # also empties Python's lists of free objects, which keep a fourth of the memory


def main(arguments: Sequence[str] | None = None) -> None:
    settings = ServerSettings.read(arguments, __doc__ or "")
    claim_state(settings.state)
    logs.setup("map_editor", settings.state / "logs")
    with open_store(settings.state / "map.sqlite", settings.building) as store:
        editor = BuildingEditor(store)
        sessions = EditSessions(editor)
        planner = PathPlanner(*editor.snapshot)
        planner.warm_up()
        editor.subscribe(lambda building, version, changes: planner.update(building, version))
        with Orb(settings.naming, settings.endpoint) as orb:
            servant = MapEditorServant(sessions, orb)
            CallLimit(READING).apply(servant, "elements", "editsSince")
            CallLimit(ANALYSING).apply(servant, "exportMap", "check", "checkFloor", "buildTopologicalMap")
            keeping = Repeating("keep", lambda: keep(sessions), KEEP_INTERVAL_S).start()
            orb.serve({"MapEditor": servant, "PathPlanner": PathPlannerServant(planner)})
            with closing(keeping):
                orb.run()


if __name__ == "__main__":
    main()
