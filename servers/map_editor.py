"""The map editor server: the map building agent and the path planning agent on one building, and proposals for it."""

from __future__ import annotations

import gc
import logging
from collections.abc import Sequence
from contextlib import ExitStack, closing

from robocorba.errors.maps import MapError
from robocorba.events.corba.event_client import Event
from robocorba.events.corba.pair_listener import PairListener
from robocorba.map_editor.author_history import AuthorHistory
from robocorba.map_editor.corba.map_editor_servant import MapEditorServant
from robocorba.map_editor.edit_session import EditSessions
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import Building
from robocorba.map_editor.proposals import DEFAULT_POLICY, Proposals
from robocorba.map_editor.sightings import seen_of
from robocorba.orb.call_limit import CallLimit
from robocorba.orb.orb import Orb
from robocorba.planning.corba.path_planner_servant import PathPlannerServant
from robocorba.planning.planner import PathPlanner
from robocorba.servers.initial_building import open_store
from robocorba.system import logs
from robocorba.system.names import ROBOTS, SIGHTING_EVENT
from robocorba.system.private_files import claim_state
from robocorba.system.record_file import KEEP_INTERVAL_S
from robocorba.system.repeating import Repeating
from robocorba.system.settings import MapEditorSettings

#: Maximum numbers of calls that the map editor executes at the same time: those that read elements, and those that go
#: through a whole floor or building. Edits, and followers of changes, don't wait for them.
READING, ANALYSING = 4, 2
#: Size of what forgotten transactions held beyond which it is worth while to search for free memory.
LARGE = 10_000
#: How far apart two robots' sightings may be made [s]: each robot repeats its own every two seconds.
SIGHTINGS_WITHIN_S = 3.0

_log = logging.getLogger(__name__)


def preload() -> None:
    """Compile or load the kernels."""
    PathPlanner(Building("none")).warm_up()


def keep(sessions: EditSessions, proposals: Proposals) -> None:
    """Write the building's file again if it was removed, settle and store proposals, and end what clients have
    forgotten."""
    sessions.editor.keep_stored()
    proposals.end_unseen()
    for due in proposals.due():
        try:
            sessions.editor.create(due.floor, due.element, AuthorHistory(f"rule: {len(due.seen_by)} robots"))
        except MapError as error:
            _log.warning("proposal %s was not accepted: %s", due.name, error)
    proposals.save()
    sessions.end_idle()
    if sessions.editor.end_idle() > LARGE:
        gc.collect()  # also empties Python's lists of free objects, which keep a fourth of the memory


def main(arguments: Sequence[str] | None = None) -> None:
    settings = MapEditorSettings.read(arguments, __doc__ or "")
    state = settings.server.state
    claim_state(state)
    logs.setup("map_editor", state / "logs")
    with open_store(state / "map.sqlite", settings.server.building) as store:
        editor = BuildingEditor(store)
        sessions = EditSessions(editor)
        planner = PathPlanner(*editor.snapshot)
        planner.warm_up()
        robots, seconds = settings.accept
        policy = DEFAULT_POLICY._replace(accept_robots=robots, accept_s=seconds)
        proposals = Proposals(editor.snapshot, planner.update, editor.proposals(), editor.save_proposals, policy)
        editor.subscribe(proposals.follow)

        def receive(seen: Sequence[Event]) -> None:
            proposals.correlate({event.source: seen_of(event.payload) for event in seen})

        with Orb(settings.server.naming, settings.server.endpoint) as orb, ExitStack() as stack:
            servant = MapEditorServant(sessions, proposals, orb)
            CallLimit(READING).apply(servant, "elements", "editsSince")
            CallLimit(ANALYSING).apply(servant, "exportMap", "check", "checkFloor", "buildTopologicalMap")
            keeping = Repeating("keep", lambda: keep(sessions, proposals), KEEP_INTERVAL_S).start()
            stack.enter_context(closing(keeping))
            orb.serve({"MapEditor": servant, "PathPlanner": PathPlannerServant(planner)})
            if settings.channel:
                listener = PairListener(
                    orb, settings.channel, SIGHTING_EVENT, lambda: orb.names(ROBOTS), SIGHTINGS_WITHIN_S, receive
                )
                stack.enter_context(closing(listener.start()))
            orb.run()


if __name__ == "__main__":
    main()
