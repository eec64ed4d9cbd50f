"""Serves the page and what it shows, and takes its commands."""

from __future__ import annotations

import hmac
import json
import secrets
import threading
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.ground.commands import COMMANDS, Answer
from ftp_dent_ros.ground.link import is_here
from ftp_dent_ros.ground.page.scene import Scene, as_json
from ftp_dent_ros.ground.protocol import Item
from ftp_dent_ros.ground.station import Station

_FILES = {
    '/': ('page.html', 'text/html; charset=utf-8'),
    '/page.css': ('page.css', 'text/css; charset=utf-8'),
    '/page.js': ('page.js', 'text/javascript; charset=utf-8'),
    '/view.js': ('view.js', 'text/javascript; charset=utf-8'),
}
# Viewers at once, and the longest that they wait for news (s), after which they are told that
# the server lives.
_MOST_VIEWERS = 16
_NEWS = 1.0
# Nothing from elsewhere: neither scripts nor pictures, nor a page around this one.
_POLICY = "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'"


class PageServer:
    """The page at an address.

    Parameters
    ----------
    address : str
        ``HOST:PORT``. Beyond this machine the page asks for a key, which `url` holds.
    scene : Scene
    link : callable
        What there is to say about the link, for JSON.
    command : callable
        Gives a command to the drone and waits for its answer.

    Raises
    ------
    ConfigurationError
        The address is malformed or cannot be listened on.
    """

    def __init__(
        self,
        address: str,
        scene: Scene,
        link: Callable[[], dict[str, Any]],
        command: Callable[[str], Answer],
    ) -> None:
        host, _, port = address.rpartition(':')
        try:
            self._server = _Server((host or '127.0.0.1', int(port)), _Handler)
        except (OSError, ValueError, OverflowError) as reason:
            why = reason.strerror if isinstance(reason, OSError) else 'no port of 0 to 65535'
            raise ConfigurationError(
                f'{address}: the page cannot be served there ({why}): give another HOST:PORT'
            ) from None
        server = self._server
        server.scene, server.link, server.command = scene, link, command
        server.key = '' if is_here(host or '127.0.0.1') else secrets.token_urlsafe(12)
        server.viewers = threading.Semaphore(_MOST_VIEWERS)
        server.stopped = threading.Event()
        shown = f'{host or "127.0.0.1"}:{server.server_address[1]}'
        self.url = f'http://{shown}/' + (f'?key={server.key}' if server.key else '')
        self._thread = threading.Thread(target=server.serve_forever, name='page', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End all connections."""
        self._server.stopped.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class Page:
    """The page of a station: what comes is shown, and its buttons command.

    Parameters
    ----------
    address : str
    station : Station
    """

    def __init__(self, address: str, station: Station) -> None:
        self._scene = Scene()

        def link() -> dict[str, Any]:
            level, text = station.summary()
            return {'level': level, 'text': text, 'rate': round(8e-3 * station.rate())}

        self._server = PageServer(address, self._scene, link, station.command)
        self.url = self._server.url

    def take(self, item: Item) -> None:
        """Show an item; raises `CodecError` if it is not what it says."""
        self._scene.take(item)

    def close(self) -> None:
        """End the page."""
        self._server.close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    scene: Scene
    link: Callable[[], dict[str, Any]]
    command: Callable[[str], Answer]
    key: str
    viewers: threading.Semaphore
    stopped: threading.Event


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    protocol_version = 'HTTP/1.1'
    timeout = 30.0

    def do_GET(self) -> None:
        path = urlsplit(self.path).path
        if not self._may_enter():
            self._send(b'the page needs its key: open the address that was printed', 'text/plain',
                       HTTPStatus.FORBIDDEN)  # fmt: skip
        elif path in _FILES:
            name, kind = _FILES[path]
            data = resources.files('ftp_dent_ros.ground.page').joinpath(name).read_bytes()
            self._send(data, kind)
        elif path == '/picture':
            self._send(self.server.scene.picture, 'image/jpeg')
        elif path == '/cloud':
            self._send(self.server.scene.cloud, 'application/octet-stream')
        elif path == '/events':
            self._send_events()
        else:
            self._send(b'there is no such page', 'text/plain', HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        name = urlsplit(self.path).path.removeprefix('/command/')
        # A page of somebody else's cannot set this header without being asked first.
        if not self._may_enter() or self.headers.get('X-Ftp-Dent') != 'command':
            self._send(b'refused', 'text/plain', HTTPStatus.FORBIDDEN)
        elif name not in COMMANDS:
            self._send(b'there is no such command', 'text/plain', HTTPStatus.NOT_FOUND)
        else:
            answer = self.server.command(name)
            text = json.dumps({'success': answer.success, 'message': answer.message})
            self._send(text.encode(), 'application/json')

    def log_message(self, *_: Any) -> None:
        """Say nothing of each request."""

    def _may_enter(self) -> bool:
        """Whether the key is right, and the page was asked for by an address, not a name.

        A foreign name that leads to this machine would make a foreign page one of ours.
        """
        key = self.server.key
        host = urlsplit(f'//{self.headers.get("Host", "")}').hostname or ''
        if not key:
            return is_here(host)
        given = parse_qs(urlsplit(self.path).query).get('key', [''])[0]
        for part in self.headers.get('Cookie', '').split(';'):
            name, _, value = part.strip().partition('=')
            if name == 'key' and not given:
                given = value
        return hmac.compare_digest(given.encode(), key.encode())

    def _send(self, data: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header('Content-Type', kind)
        self.send_header('Content-Length', str(len(data)))
        self.send_header('Cache-Control', 'no-store')
        self.send_header('Content-Security-Policy', _POLICY)
        self.send_header('X-Content-Type-Options', 'nosniff')
        if self.server.key and status is HTTPStatus.OK:
            cookie = f'key={self.server.key}; HttpOnly; SameSite=Strict; Path=/'
            self.send_header('Set-Cookie', cookie)
        self.end_headers()
        self.wfile.write(data)

    def _send_events(self) -> None:
        """Tell of every change, and once a second of the link (server-sent events)."""
        if not self.server.viewers.acquire(blocking=False):
            self._send(b'too many viewers', 'text/plain', HTTPStatus.SERVICE_UNAVAILABLE)
            return
        try:
            self.send_response(HTTPStatus.OK)
            self.send_header('Content-Type', 'text/event-stream')
            self.send_header('Cache-Control', 'no-store')
            self.send_header('Connection', 'close')
            self.end_headers()
            scene, before = self.server.scene, -1
            while not self.server.stopped.is_set():
                news: dict[str, Any] = {'link': self.server.link()}
                if scene.version != before:
                    news.update(scene.state())
                    before = int(news['version'])
                self.wfile.write(b'data: ' + as_json(news) + b'\n\n')
                self.wfile.flush()
                self.server.stopped.wait(0.2)  # not more often, however much comes
                with scene.changed:
                    scene.changed.wait_for(lambda: scene.version != before, _NEWS)  # noqa: B023
        except OSError:  # the viewer is gone
            return
        finally:
            self.server.viewers.release()
            self.close_connection = True
