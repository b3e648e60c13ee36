"""The viewer's server: viser on a loopback port of its own, and one session for every open tab."""

import logging
import threading
from collections.abc import Callable

import rich
import viser

from tidemap.errors import TooManyTabsError
from tidemap.services.context import Context
from tidemap.services.keys import OPEN, Principal
from tidemap_web.viewer.board import warm
from tidemap_web.viewer.inner import SHOWN_IN, InnerViser, token_of
from tidemap_web.viewer.messages import PageMessage
from tidemap_web.viewer.news import Fresh, News
from tidemap_web.viewer.picking import Ray
from tidemap_web.viewer.scene import Scene
from tidemap_web.viewer.session import Session
from tidemap_web.viewer.source import Services

_log = logging.getLogger(__name__)


class ViewerServer:
    """Runs viser and the sessions. Viser itself asks nobody for a key: reach it through `viewer.proxy` only."""

    def __init__(self, ctx: Context) -> None:
        self._ctx = ctx
        self._sessions: dict[str, Session] = {}
        self._keys: dict[str, int | None] = {}
        self._lock = threading.Lock()
        self._viser: InnerViser | None = None
        self._news = News(self._notify)

    @property
    def port(self) -> int:
        """Viser's port on 127.0.0.1. Raises RuntimeError before start."""
        if self._viser is None:
            raise RuntimeError("the viewer is not running")
        return self._viser.get_port()

    @property
    def headers(self) -> dict[str, str]:
        """What a connection to `port` has to show. Raises RuntimeError before start."""
        if self._viser is None:
            raise RuntimeError("the viewer is not running")
        return {SHOWN_IN: self._viser.secret}

    def start(self) -> None:
        """Open viser's port and listen to the event bus."""
        warm()
        rich.get_console().quiet = True  # viser greets on standard output, which is ours
        self._viser = InnerViser(self.knows)
        self._viser.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        self._viser.on_client_connect(self._welcome)
        self._news.start(self._ctx.bus)

    def stop(self) -> None:
        """Close all sessions and the port."""
        self._news.stop()
        with self._lock:
            sessions, self._sessions, self._keys = list(self._sessions.values()), {}, {}
        for session in sessions:
            session.close()
        if self._viser is not None:
            self._viser.stop()
            self._viser = None

    def open(self, token: str, publish: Callable[[PageMessage], None], principal: Principal = OPEN) -> Session:
        """A session for a tab, which sees what its principal may; one with the same token before it is closed.

        Raises TooManyTabsError.
        """
        session = Session(token, Services(self._ctx, principal.scope), publish)
        with self._lock:
            self._check_room(token, principal.key_id)
            before, self._sessions[token] = self._sessions.get(token), session
            self._keys[token] = principal.key_id
        if before is not None:
            before.close()
        session.start()
        self._rejoin(session)
        return session

    def close(self, session: Session) -> None:
        """The tab has gone."""
        session.close()
        with self._lock:
            if self._sessions.get(session.token) is session:
                del self._sessions[session.token], self._keys[session.token]

    def _check_room(self, token: str, key_id: int | None) -> None:
        others = sum(key == key_id for tab, key in self._keys.items() if tab != token)
        if others >= self._ctx.settings.viewer_tabs:
            raise TooManyTabsError(self._ctx.settings.viewer_tabs)

    def knows(self, token: str) -> bool:
        """Whether a tab with this token is open."""
        with self._lock:
            return token in self._sessions

    def stats(self) -> list[PageMessage]:
        """All sessions in short."""
        with self._lock:
            sessions = list(self._sessions.values())
        return [session.stats() for session in sessions]

    def _welcome(self, client: viser.ClientHandle) -> None:
        token = self._token(client)
        with self._lock:
            session = self._sessions.get(token)
        if session is not None:
            self._attach(session, client)

    def _rejoin(self, session: Session) -> None:
        """Give a reopened session the scene that its tab has kept open."""
        clients = self._viser.get_clients().values() if self._viser else ()
        for client in clients:
            if self._token(client) == session.token:
                self._attach(session, client)

    def _attach(self, session: Session, client: viser.ClientHandle) -> None:
        @client.scene.on_click()
        def _(event: viser.SceneClickEvent) -> None:
            session.pick(Ray.of(event.ray_origin, event.ray_direction, client.camera.wxyz))

        scene = Scene(client)

        @client.camera.on_update
        def _(_: viser.CameraHandle) -> None:
            if scene.placed:
                session.camera_moved(scene.pose())

        session.attach(scene)

    def _token(self, client: viser.ClientHandle) -> str:
        """The tab's token, which the proxy put into the address it connected to."""
        if self._viser is None:
            return ""
        connection = self._viser._websock_server._live_connections.get(client.client_id)
        if connection is None or connection.request is None:
            return ""
        return token_of(connection.request)

    def _notify(self, fresh: Fresh) -> None:
        with self._lock:
            sessions = list(self._sessions.values())
        for session in sessions:
            session.notify(fresh)
