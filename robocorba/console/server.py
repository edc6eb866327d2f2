"""The console's web server: NiceGUI's pages, plans and live frames for them, and the operations that they call."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI, Request, Response, WebSocket
from fastapi.responses import JSONResponse
from fastapi.staticfiles import StaticFiles
from nicegui import ui

from robocorba.console.access import Access
from robocorba.console.calls import answer_call
from robocorba.console.history import History
from robocorba.console.live_floors import LiveFloors
from robocorba.console.live_plans import LivePlans
from robocorba.console.map_operations import MapOperations
from robocorba.console.mission_operations import MissionOperations
from robocorba.console.operations import Operations
from robocorba.console.pages import add_pages
from robocorba.console.process_operations import ProcessOperations
from robocorba.console.program_operations import ProgramOperations
from robocorba.console.settings import ConsoleSettings
from robocorba.console.simulation_operations import SimulationOperations
from robocorba.console.system_state import SystemState
from robocorba.console.viewers import Viewers
from robocorba.corba.orb import Orb
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import PortInUse, ServiceError

STATIC = Path(__file__).parent / "static"
#: The server ends at most this long after a signal, also while browsers are connected [s].
SHUTDOWN_S = 2


class Console:
    """A console of the system that `orb` is connected with."""

    def __init__(self, orb: Orb, settings: ConsoleSettings) -> None:
        self._settings = settings
        self.history = History()
        self.state = SystemState(orb)
        self.viewers = Viewers(self.state)
        self.floors = LiveFloors(orb, self.history, lambda floor: self.viewers.notify())
        self.plans = LivePlans(orb, self.viewers.notify)
        self.operations = Operations(orb)
        for part in (ProgramOperations(orb), MapOperations(orb), MissionOperations(orb)):
            self.operations.add(part)
        self.operations.add(SimulationOperations(orb, settings.administrator, settings.supervisor))
        self.operations.add(ProcessOperations(orb, settings.supervisor))

    def app(self) -> Access:
        """The web application."""
        app = FastAPI(
            title="RoboCorba console", docs_url=None, redoc_url=None, openapi_url=None, lifespan=self._running
        )
        app.mount("/static", _Static(directory=STATIC), "static")
        app.add_api_route("/plan", self._plan)
        app.add_api_route("/past", self._past)
        app.add_api_route("/robot-model", self._robot_model)
        app.add_api_route("/call/{name}", self._call, methods=["POST"])
        app.add_api_websocket_route("/live", self._live)
        add_pages()
        ui.run_with(
            app,
            title="RoboCorba",
            dark=None,
            favicon=STATIC / "favicon.svg",
            reconnect_timeout=10.0,
            show_welcome_message=False,
        )
        return Access(app, self._settings.hosts, self._settings.password)

    @contextlib.asynccontextmanager
    async def _running(self, app: FastAPI) -> AsyncIterator[None]:
        self.viewers.attach(self.floors, self.plans)
        parts = (self.state, self.plans, self.floors)
        for part in parts:
            part.start()
        try:
            yield
        finally:
            for part in parts:
                await asyncio.to_thread(part.close)

    async def _live(self, socket: WebSocket) -> None:
        await self.viewers.serve(socket)

    async def _plan(self, floor: str) -> Response:
        try:
            plan = await asyncio.to_thread(self.plans.plan, floor)
        except UnknownFloor as error:
            return JSONResponse({"error": str(error)}, 404)
        return Response(plan, media_type="application/json")

    async def _robot_model(self) -> Response:
        from robocorba.kinematics.link_tree import as_json  # imported here, since it loads the physics engine

        return JSONResponse(await asyncio.to_thread(as_json))

    async def _past(self, floor: str, at: float) -> Response:
        """The frame of a floor at POSIX time `at` [s]."""
        try:
            return Response(self.history.frame(floor, at), media_type="application/octet-stream")
        except UnknownFloor as error:
            return JSONResponse({"error": str(error)}, 404)

    async def _call(self, name: str, request: Request) -> Response:
        return await answer_call(self.operations, name, request)


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
        timeout_graceful_shutdown=SHUTDOWN_S,
        ws_max_size=64 * 1024,
    )
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

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started and sockets:
            scheme = "https" if self.config.ssl_certfile else "http"
            print(f"{scheme}://{self._host}:{sockets[0].getsockname()[1]}/", flush=True)
            print("ready", flush=True)
