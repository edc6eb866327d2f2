"""A WebSocket server for Foxglove: what a publisher publishes, and Foxglove's playback control of the simulation."""

from __future__ import annotations

import contextlib
import queue
import threading
from typing import NamedTuple

import foxglove
from foxglove.websocket import (
    Capability,
    ChannelView,
    Client,
    PlaybackCommand,
    PlaybackControlRequest,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
)

from robocorba.bridges.foxglove.publisher import FoxglovePublisher
from robocorba.bridges.foxglove.shapes import nanoseconds
from robocorba.errors.services import ServiceError
from robocorba.map_editor.model import Building


class PlaybackRequest(NamedTuple):
    """A request of a client. pace: simulated seconds per second. id: for the answer."""

    is_paused: bool
    pace: float
    id: str


class LiveServer:
    """Serves the messages of its `publisher`, from its construction until `close`. port: 0 for a free one.

    is_steerable: whether clients may pause the simulation and set its pace; then time_s is its time [s].
    Raises ServiceError if the address is taken."""

    def __init__(
        self, host: str, port: int, building: Building, is_steerable: bool = False, time_s: float = 0.0
    ) -> None:
        context = foxglove.Context()
        self._listener = _Listener()
        span = nanoseconds(time_s), nanoseconds(time_s + 24 * 3600.0)  # what Foxglove's time line shows
        try:
            self._server = foxglove.start_server(
                name="RoboCorba",
                host=host,
                port=port,
                capabilities=[Capability.Time, *([Capability.PlaybackControl] if is_steerable else [])],
                server_listener=self._listener,
                context=context,
                playback_time_range=span if is_steerable else None,
                message_backlog_size=1024,  # for a slow client; beyond that the oldest are dropped
            )
        except (OSError, RuntimeError) as error:
            raise ServiceError(f"{host}:{port}: {error}") from None
        self.publisher = FoxglovePublisher(context, building)

    @property
    def port(self) -> int:
        return self._server.port

    @property
    def is_watched(self) -> bool:
        """Whether a client has subscribed to something."""
        return bool(self._listener.subscriptions)

    def tick(self) -> None:
        """Publish the simulated time, and everything again if a client has subscribed since the last call."""
        self._listener.time_ns = nanoseconds(self.publisher.time_s)
        self._server.broadcast_time(self._listener.time_ns)
        if self._listener.has_new.is_set():
            self._listener.has_new.clear()
            self.publisher.repeat()

    def requests(self) -> list[PlaybackRequest]:
        """The requests of clients since the last call."""
        found = []
        while not self._listener.requests.empty():
            found.append(self._listener.requests.get())
        return found

    def report_playback(self, is_paused: bool, pace: float, request: str = "") -> None:
        """Show clients whether the simulation is paused, and its pace. request: id of a request that this answers."""
        status = PlaybackStatus.Paused if is_paused else PlaybackStatus.Playing
        at = nanoseconds(self.publisher.time_s)
        self._server.broadcast_playback_state(PlaybackState(status, at, pace, False, request or None))

    def report_problem(self, text: str) -> None:
        """Show clients a problem; empty: it is over."""
        if text:
            self._server.publish_status(text, foxglove.StatusLevel.Warning, "problem")
        else:
            self._server.remove_status(["problem"])

    def close(self) -> None:
        self._server.stop()


class _Listener(ServerListener):
    """Notes what clients want; its methods are called by threads of the server."""

    def __init__(self) -> None:
        #: Simulated time [ns].
        self.time_ns = 0
        self.subscriptions: set[tuple[int, int]] = set()
        self.has_new = threading.Event()
        #: Those that wait; more are dropped.
        self.requests: queue.Queue[PlaybackRequest] = queue.Queue(16)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self.subscriptions.add((client.id, channel.id))
        self.has_new.set()

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        self.subscriptions.discard((client.id, channel.id))

    def on_playback_control_request(self, playback_control_request: PlaybackControlRequest) -> PlaybackState | None:
        wanted = playback_control_request
        is_paused = wanted.playback_command == PlaybackCommand.Pause
        with contextlib.suppress(queue.Full):
            self.requests.put_nowait(PlaybackRequest(is_paused, wanted.playback_speed, wanted.request_id))
        # The answer proper comes when the simulation has obeyed.
        return PlaybackState(PlaybackStatus.Buffering, self.time_ns, wanted.playback_speed, False, wanted.request_id)
