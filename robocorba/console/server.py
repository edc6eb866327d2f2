"""The console's web server: NiceGUI's pages, plans and live frames for them, and the operations that they call."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import socket
import tempfile
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI, Request, Response, WebSocket
from fastapi.responses import FileResponse, JSONResponse
from fastapi.staticfiles import StaticFiles
from nicegui import ui

from robocorba.console.access import Access
from robocorba.console.arguments import NotPossible
from robocorba.console.calls import Calls
from robocorba.console.films import Films
from robocorba.console.history import History
from robocorba.console.leaving import in_thread
from robocorba.console.live_floors import LiveFloors
from robocorba.console.live_missions import LiveMissions
from robocorba.console.live_plans import LivePlans
from robocorba.console.live_sensors import LiveSensors
from robocorba.console.map_operations import MapOperations
from robocorba.console.mission_operations import MissionOperations
from robocorba.console.monitor_operations import MonitorOperations
from robocorba.console.monitor_state import MonitorState
from robocorba.console.operations import RESOLVE_TIMEOUT_S, Operations
from robocorba.console.pages import STATIC, add_pages
from robocorba.console.panel_operations import PanelOperations
from robocorba.console.past_files import PastFiles
from robocorba.console.program_operations import ProgramOperations
from robocorba.console.recordings import OPENING_LIMIT_S, Recordings
from robocorba.console.robot_views import RobotViews
from robocorba.console.settings import ConsoleSettings, dates_problem
from robocorba.console.system_operations import SystemOperations
from robocorba.console.system_state import SystemState
from robocorba.console.viewers import Viewers
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import PortInUse, ServiceError
from robocorba.errors.simulation import InvalidRecording
from robocorba.events.arrival_clock import ArrivalClock
from robocorba.missions.cooperative_planner import MakePlanner
from robocorba.missions.corba.remote_mission_control import RemoteMissionControl
from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_data_pool import RemotePool
from robocorba.robot.corba.remote_scans import live_scans
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.system.decoding import Work

#: Largest recording that a user may open [bytes].
MAX_RECORDING = 512 * 1024 * 1024

_log = logging.getLogger(__name__)


class Console:
    """A console of the system that `orb` is connected with. planner_of: see MissionOperations."""

    def __init__(self, orb: Orb, settings: ConsoleSettings, planner_of: Callable[[Any], MakePlanner]) -> None:
        self._settings = settings
        self.history = History(epoch=ArrivalClock().epoch)
        self.state = MonitorState(SystemState(orb), self.history, lambda: self.plans.building)
        self.past = PastFiles(
            settings.common.state / "past", self.history, self.state.happenings, lambda: self.plans.building
        )
        self.recordings, self.films = Recordings(), Films()
        if settings.recording is not None:
            self.recordings.open(settings.recording, settings.recording.name)
        self.viewers = Viewers(self.state, settings.viewers)
        self.floors = LiveFloors(orb, self.history, self.viewers.notify)
        self.plans = LivePlans(orb, self.viewers.notify, self.history.rename)
        database = RemoteDatabase(orb, RESOLVE_TIMEOUT_S)
        self.scans = live_scans(orb)
        self.sensors = LiveSensors(
            database,
            lambda floor: self.floors.floor(floor).time,
            lambda floors, first: self.scans.read(self.floors.robots(floors), first=first),
            self.viewers.notify,
        )
        self.missions = LiveMissions(RemoteMissionControl(orb, RESOLVE_TIMEOUT_S), self.viewers.notify)
        self.robot_views = RobotViews(lambda robot: RemotePool(orb, robot, 1.0))
        self.operations = Operations(orb, settings.common.state)
        programs = ProgramOperations(orb, folder=settings.programs)
        for part in (
            MonitorOperations(
                self.state, self.history, lambda: self.plans.building, self.recordings, self.films, self.past
            ),
            SystemOperations(orb, settings.administrator, settings.supervisor),
            programs,
            PanelOperations(self.operations, programs, self.state.rows),
            MapOperations(orb),
            MissionOperations(orb, self.state.rows, planner_of),
        ):
            self.operations.add(part)
        self.calls = Calls(self.operations)

    def app(self) -> Access:
        """The web application."""
        app = FastAPI(
            title="RoboCorba console", docs_url=None, redoc_url=None, openapi_url=None, lifespan=self._running
        )
        app.mount("/static", _Static(directory=STATIC), "static")
        app.add_api_route("/plan", self._plan)
        app.add_api_route("/past", self._past)
        app.add_api_route("/recording", self._open_recording, methods=["POST"])
        app.add_api_route("/film/{number}", self._film)
        app.add_api_route("/robot-model", self._robot_model)
        app.add_api_route("/robot.urdf", self._robot_urdf)
        app.add_api_route("/call/{name}", self.calls.answer, methods=["POST"])
        app.add_api_route("/panel-call/{name}/{robot:path}", self.calls.answer_panel, methods=["POST"])
        app.add_api_websocket_route("/live", self.viewers.serve)
        app.add_api_websocket_route("/robot-view", self._robot_view)
        add_pages()
        ui.run_with(
            app,
            title="RoboCorba",
            language="en-US",
            dark=None,
            favicon=STATIC / "favicon.svg",
            reconnect_timeout=10.0,
            show_welcome_message=False,
        )
        return Access(app, self._settings.hosts, self._settings.password, pins=self._settings.pins)

    @contextlib.asynccontextmanager
    async def _running(self, app: FastAPI) -> AsyncIterator[None]:
        self.viewers.attach(self.floors, self.plans, self.sensors, self.missions)
        started = (self.state, self.plans, self.floors, self.sensors, self.missions, self.past)
        for part in started:
            part.start()
        try:
            yield
        finally:
            for each in (*started, self.scans, self.films, self.calls, self.robot_views):
                await asyncio.to_thread(each.close)

    async def _robot_view(self, socket: WebSocket) -> None:
        wanted = socket.query_params
        await self.robot_views.serve(socket, wanted.get("robot", ""), wanted.get("pool") == "yes")

    async def _plan(self, floor: str, recording: str = "") -> Response:
        """The map of a floor, as it is or as an open recording has it."""
        try:
            if recording:
                return JSONResponse(await asyncio.to_thread(self.recordings.get(recording).plan, floor))
            plan = await asyncio.to_thread(self.plans.plan, floor)
        except (UnknownFloor, NotPossible) as error:
            return JSONResponse({"error": str(error)}, 404)
        return Response(plan, media_type="application/json")

    async def _robot_model(self) -> Response:
        return JSONResponse(await asyncio.to_thread(_link_tree))

    async def _robot_urdf(self) -> Response:
        """The robot for other viewers."""
        return Response(
            await asyncio.to_thread(_urdf),
            media_type="application/xml",
            headers={"Content-Disposition": 'attachment; filename="smartpal.urdf"'},
        )

    async def _past(self, floor: str, at: float, recording: str = "") -> Response:
        """The frame of a floor at POSIX time `at` [s], of an open recording or of the last half hour."""
        try:
            history = self.recordings.get(recording).history if recording else self.history
            return Response(history.frame(floor, at), media_type="application/octet-stream")
        except (UnknownFloor, NotPossible) as error:
            return JSONResponse({"error": str(error)}, 404)

    async def _open_recording(self, request: Request, name: str = "recording") -> Response:
        """Open the recording in the body of the request; its row."""
        try:
            with tempfile.NamedTemporaryFile(prefix="robocorba-", suffix=".mcap") as file:
                size = 0
                async for piece in request.stream():
                    size += len(piece)
                    if size > MAX_RECORDING:
                        raise RoboCorbaError(f"the recording is longer than {MAX_RECORDING // 2**20} MiB")
                    await asyncio.to_thread(file.write, piece)
                file.flush()
                work = Work(OPENING_LIMIT_S)
                opened = await in_thread(request, work, lambda: self.recordings.open(Path(file.name), name, work))
        except InvalidRecording as error:
            return JSONResponse({"error": f"{name[:80]}: {error.reason}"})
        except (RoboCorbaError, OSError) as error:
            return JSONResponse({"error": str(error)})
        return JSONResponse({"answer": opened.row()})

    async def _film(self, number: int) -> Response:
        """A film as a download."""
        try:
            return FileResponse(self.films.file(number), media_type="video/mp4", filename=f"robocorba-{number}.mp4")
        except NotPossible as error:
            return JSONResponse({"error": str(error)}, 404)


# Made in a thread of their own, not in that of the event loop.


def _link_tree() -> Any:
    from robocorba.robot.kinematics.link_tree import as_json

    return as_json()


def _urdf() -> str:
    from robocorba.robot.kinematics.urdf import urdf

    return urdf()


class _Static(StaticFiles):
    """Files of the console: browsers ask each time whether they have changed."""

    def file_response(self, *arguments: Any, **options: Any) -> Response:
        response = super().file_response(*arguments, **options)
        response.headers["Cache-Control"] = "no-cache"
        return response


def serve(console: Console, settings: ConsoleSettings) -> None:
    """Serve until SIGINT or SIGTERM. Raises PortInUse, ServiceError."""
    config = uvicorn.Config(
        console.app(),
        log_level="warning",
        ssl_certfile=settings.certificate,
        ssl_keyfile=settings.key,
        timeout_graceful_shutdown=2,  # [s], also while browsers are connected
        ws_max_size=64 * 1024,
    )
    if settings.certificate and (problem := dates_problem(settings.certificate)):
        _log.warning("%s", problem)
    with listening(settings.host, settings.port) as listener:
        _Server(config, settings.host).run([listener])


def listening(host: str, port: int) -> socket.socket:
    """A socket that listens there. Raises PortInUse, ServiceError."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=128)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise PortInUse(host, port, "the console") from None
        raise ServiceError(f"can't listen on {host}, port {port}: {error.strerror}") from None


class _Server(uvicorn.Server):
    """Prints its address when it accepts connections."""

    def __init__(self, config: uvicorn.Config, host: str) -> None:
        super().__init__(config)
        self._host = host if ":" not in host else f"[{host}]"

    def handle_exit(self, sig: int, frame: object) -> None:
        """End the server; uvicorn would raise the signal again then, and end the process by it."""
        self.should_exit = True

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started and sockets:
            scheme = "https" if self.config.ssl_certfile else "http"
            print(f"{scheme}://{self._host}:{sockets[0].getsockname()[1]}/", flush=True)
            print("ready", flush=True)
