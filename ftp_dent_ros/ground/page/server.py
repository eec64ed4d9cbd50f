"""Serves the page and Foxglove's WebSocket to those who know the key, and takes commands.

Of Foxglove's subprotocols ``foxglove.sdk.v1`` and ``foxglove.websocket.v1``: channels are
advertised as JSON; a message is the byte 1, the subscription (uint32), the time (uint64, ns) and
the data.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
import struct
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from aiohttp import WSMsgType, web

from ftp_dent_ros.errors import CodecError, ConfigurationError
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.commands import COMMANDS
from ftp_dent_ros.ground.page.scene import PageScene, message_of
from ftp_dent_ros.ground.protocol import Item
from ftp_dent_ros.ground.station import Station
from ftp_dent_ros.recording.compression import cloud_message
from ftp_dent_ros.recording.topic import known_topic, typestore

PROTOCOLS = ('foxglove.sdk.v1', 'foxglove.websocket.v1')
_HEAD = struct.Struct('<BIQ')
_PICTURE, _CLOUD = 'sensor_msgs/msg/CompressedImage', 'sensor_msgs/msg/PointCloud2'
_FIELDS = 6  # of a cloud: x, y, z, intensity, sigma, resolution
_WAITING = 64  # messages that wait for a slow client; the oldest give way

_FOXGLOVE = '/foxglove'
# Nothing from elsewhere: neither scripts nor pictures, nor a page around this one.
_HEADERS = {
    'Cache-Control': 'no-store',
    'Content-Security-Policy': "default-src 'self'; img-src 'self' blob: data:; "
    "frame-ancestors 'none'",
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer',
}
# Seconds between two events at least; of so many without news, one says that the server lives.
_PAUSE, _PAUSES = 0.2, 5


def encode_message(item: Item) -> tuple[str, bytes]:
    """Type and serialised message of an item.

    Raises
    ------
    CodecError
        The item is not what it says.
    """
    store = typestore()
    seconds, nanoseconds = divmod(item.stamp_ns, 10**9)
    try:
        stamp = store.types['builtin_interfaces/msg/Time'](sec=seconds, nanosec=nanoseconds)
        header = store.types['std_msgs/msg/Header'](stamp=stamp, frame_id=item.frame)
        if item.kind == 'cloud':
            kind, message = _CLOUD, cloud_message(header, item.data, _FIELDS)
        elif item.kind == 'jpeg':
            data = np.frombuffer(item.data, np.uint8)
            kind, message = _PICTURE, store.types[_PICTURE](header, 'jpeg', data)
        else:
            kind, message = item.kind.removeprefix('cdr:'), message_of(item)
        return kind, bytes(store.serialize_cdr(message, kind))
    except (ValueError, TypeError, KeyError):
        raise CodecError(f'an item of {item.topic} is malformed: it is refused') from None


class Foxglove:
    """Channels and the clients that subscribe to them; for one event loop alone."""

    def __init__(self) -> None:
        self._channels: dict[str, dict[str, Any]] = {}
        self._clients: dict[asyncio.Queue[str | bytes], dict[int, int]] = {}

    def publish(self, item: Item, kind: str, data: bytes) -> None:
        """Send a message to who subscribes to its topic."""
        name = '/' + item.topic.lstrip('/') + ('/compressed' if item.topic == topics.IMAGE else '')
        channel = self._channels.get(name)
        if channel is None:
            channel = self._channels[name] = self._new_channel(name, kind)
            for client in self._clients:
                _put(client, _advertise([channel]))
        for client, subscriptions in self._clients.items():
            for subscription, wanted in subscriptions.items():
                if wanted == channel['id']:
                    _put(client, _HEAD.pack(1, subscription, item.stamp_ns) + data)

    async def serve(self, request: web.Request) -> web.WebSocketResponse:
        """Serve one client until it leaves."""
        socket = web.WebSocketResponse(protocols=PROTOCOLS, max_msg_size=1 << 20, heartbeat=30.0)
        await socket.prepare(request)
        client: asyncio.Queue[str | bytes] = asyncio.Queue(_WAITING)
        subscriptions = self._clients[client] = {}
        hello = {'op': 'serverInfo', 'name': 'ftp_dent_ros', 'capabilities': [], 'metadata': {}}
        _put(client, json.dumps(hello))
        _put(client, _advertise(list(self._channels.values())))
        sender = asyncio.create_task(_send(socket, client))
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    with suppress(ValueError, KeyError, TypeError, AttributeError):
                        _subscribe(subscriptions, json.loads(message.data))
        finally:
            del self._clients[client]
            sender.cancel()
        return socket

    def _new_channel(self, name: str, kind: str) -> dict[str, Any]:
        return {
            'id': len(self._channels) + 1,
            'topic': name,
            'encoding': 'cdr',
            'schemaName': kind,
            'schema': known_topic(name, kind).definition,
            'schemaEncoding': 'ros2msg',
        }


def _advertise(channels: list[dict[str, Any]]) -> str:
    return json.dumps({'op': 'advertise', 'channels': channels})


def _subscribe(subscriptions: dict[int, int], request: dict[str, Any]) -> None:
    if request['op'] == 'subscribe':
        for each in request['subscriptions']:
            subscriptions[int(each['id'])] = int(each['channelId'])
    elif request['op'] == 'unsubscribe':
        for each in request['subscriptionIds']:
            subscriptions.pop(int(each), None)


def _put(client: asyncio.Queue[str | bytes], data: str | bytes) -> None:
    if client.full():
        client.get_nowait()
    client.put_nowait(data)


async def _send(socket: web.WebSocketResponse, client: asyncio.Queue[str | bytes]) -> None:
    with suppress(ConnectionError):
        while True:
            data = await client.get()
            await (socket.send_str(data) if isinstance(data, str) else socket.send_bytes(data))


class PageServer:
    """The page at an address; a key in `url` opens it, and nothing else does.

    Parameters
    ----------
    address : str
        ``HOST:PORT``.
    station : Station
        Tells of the link, and gives the commands to the drone.

    Attributes
    ----------
    url, foxglove_url : str
        Of the page, and of the WebSocket, with the key.

    Raises
    ------
    ConfigurationError
        The address is malformed or cannot be listened on.
    """

    def __init__(self, address: str, station: Station) -> None:
        self.scene = PageScene()
        self._foxglove = Foxglove()
        self._station = station
        self._key = secrets.token_urlsafe(12)
        self._loop = asyncio.new_event_loop()
        folder = resources.files('ftp_dent_ros.ground.page')
        #: What is at each path, and of which type.
        self._contents: dict[str, tuple[Callable[[], bytes], str]] = {
            '/': (folder.joinpath('page.html').read_bytes, 'text/html'),
            '/page.css': (folder.joinpath('page.css').read_bytes, 'text/css'),
            '/page.js': (folder.joinpath('page.js').read_bytes, 'text/javascript'),
            '/view.js': (folder.joinpath('view.js').read_bytes, 'text/javascript'),
            '/picture': (lambda: self.scene.picture, 'image/jpeg'),
            '/cloud': (lambda: self.scene.cloud, 'application/octet-stream'),
        }
        app = web.Application(middlewares=[self._guard])
        app.add_routes(
            [
                *(web.get(path, self._content) for path in self._contents),
                web.get('/events', self._events),
                web.get(_FOXGLOVE, self._foxglove.serve),
                web.post('/command/{name}', self._do),
            ]
        )
        self._runner = web.AppRunner(app, access_log=None, shutdown_timeout=0.5)
        host, _, port = address.rpartition(':')
        host = host or '127.0.0.1'
        try:
            self._loop.run_until_complete(self._listen(host.strip('[]'), int(port)))
        except (OSError, ValueError, OverflowError) as reason:
            self._loop.run_until_complete(self._runner.cleanup())
            self._loop.close()
            why = reason.strerror if isinstance(reason, OSError) else 'no port of 0 to 65535'
            raise ConfigurationError(
                f'{address}: the page cannot be served there ({why}): give another HOST:PORT'
            ) from None
        port = self._runner.addresses[0][1]
        # Pages of two grounds on one host share their cookies, but for the names.
        self._cookie = f'key_{port}'
        self.url = f'http://{host}:{port}/?key={self._key}'
        self.foxglove_url = f'ws://{host}:{port}{_FOXGLOVE}?key={self._key}'
        self._thread = threading.Thread(target=self._loop.run_forever, name='page', daemon=True)
        self._thread.start()

    def take(self, item: Item) -> None:
        """Show an item; raises `CodecError` if it is not what it says."""
        self.scene.take(item)
        kind, data = encode_message(item)
        self._loop.call_soon_threadsafe(self._foxglove.publish, item, kind, data)

    def close(self) -> None:
        """End all connections."""
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(10.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _listen(self, host: str, port: int) -> None:
        await self._runner.setup()
        await web.TCPSite(self._runner, host, port).start()

    async def _end(self) -> None:
        await self._runner.cleanup()
        served = asyncio.all_tasks() - {asyncio.current_task()}
        for task in served:
            task.cancel()
        await asyncio.gather(*served, return_exceptions=True)

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Let in who knows the key; a page of another origin only as a client of Foxglove's."""
        given = request.query.get('key', '')
        origin = urlsplit(request.headers.get('Origin', '')).netloc
        is_ours = origin in ('', request.host)
        key = given or (request.cookies.get(self._cookie, '') if is_ours else '')
        if not hmac.compare_digest(key.encode(), self._key.encode()):
            return _refuse(403, 'the page needs its key: open the address that was printed')
        if not is_ours and request.path != _FOXGLOVE:
            return _refuse(403, 'refused: asked for by a page of another origin')
        if request.can_read_body:
            return _refuse(400, 'refused: no request here has a body')
        response = await handler(request)
        if given and not response.prepared:
            response.set_cookie(self._cookie, self._key, httponly=True, samesite='Strict')
        return response

    async def _content(self, request: web.Request) -> web.Response:
        read, kind = self._contents[request.path]
        return web.Response(body=read(), content_type=kind, headers=_HEADERS)

    async def _do(self, request: web.Request) -> web.Response:
        name = request.match_info['name']
        # A page of somebody else's cannot set this header without being asked first.
        if request.headers.get('X-Ftp-Dent') != 'command':
            return _refuse(403, 'refused')
        if name not in COMMANDS:
            return _refuse(404, 'there is no such command')
        answer = await asyncio.to_thread(self._station.command, name)
        return web.Response(body=answer.pack(), content_type='application/json', headers=_HEADERS)

    async def _events(self, request: web.Request) -> web.StreamResponse:
        """Say every change, and once a second the link's state (server-sent events)."""
        response = web.StreamResponse(headers={**_HEADERS, 'Content-Type': 'text/event-stream'})
        await response.prepare(request)
        shown = -1
        while True:
            level, text = self._station.summary()
            link = {'level': level, 'text': text, 'rate': round(8e-3 * self._station.rate())}
            news: dict[str, Any] = {'link': link}
            if self.scene.version != shown:
                news.update(self.scene.state())
                shown = int(news['version'])
            text = json.dumps(news, separators=(',', ':'), allow_nan=False)
            await response.write(f'data: {text}\n\n'.encode())
            for _ in range(_PAUSES):
                await asyncio.sleep(_PAUSE)
                if self.scene.version != shown:
                    break


def _refuse(status: int, text: str) -> web.Response:
    response = web.Response(status=status, text=text, headers=_HEADERS)
    response.force_close()  # nothing that follows on the connection is read
    return response
