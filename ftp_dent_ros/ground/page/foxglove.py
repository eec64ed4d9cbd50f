"""What comes to the ground in Foxglove's WebSocket protocol, without ROS.

Of its subprotocols ``foxglove.sdk.v1`` and ``foxglove.websocket.v1``: channels are advertised as
JSON; a message is the byte 1, the subscription (uint32), the time (uint64, ns) and the data.
"""

from __future__ import annotations

import asyncio
import json
import struct
from contextlib import suppress
from typing import Any

import numpy as np
from aiohttp import WSMsgType, web

from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.page.scene import message_of
from ftp_dent_ros.ground.protocol import Item

PROTOCOLS = ('foxglove.sdk.v1', 'foxglove.websocket.v1')
_HEAD = struct.Struct('<BIQ')
_PICTURE, _CLOUD = 'sensor_msgs/msg/CompressedImage', 'sensor_msgs/msg/PointCloud2'
_FIELDS = 6  # of a cloud: x, y, z, intensity, sigma, resolution
_WAITING = 64  # messages that wait for a slow client; the oldest give way


def encode_message(item: Item) -> tuple[str, bytes]:
    """Type and serialised message of an item.

    Raises
    ------
    CodecError
        The item is not what it says.
    """
    from ftp_dent_ros.recording import topic
    from ftp_dent_ros.recording.compression import cloud_message

    store = topic.typestore()
    seconds, rest = divmod(item.stamp_ns, 10**9)
    try:
        header = store.types['std_msgs/msg/Header'](
            stamp=store.types['builtin_interfaces/msg/Time'](sec=seconds, nanosec=rest),
            frame_id=str(item.extra.get('frame', '')),
        )
        if item.kind == 'cloud':
            cloud = cloud_message(header, item.data, _FIELDS)
            return _CLOUD, bytes(store.serialize_cdr(cloud, _CLOUD))
        if item.kind == 'jpeg':
            data = np.frombuffer(item.data, np.uint8)
            picture = store.types[_PICTURE](header=header, format='jpeg', data=data)
            return _PICTURE, bytes(store.serialize_cdr(picture, _PICTURE))
        kind = item.kind.removeprefix('cdr:')
        if not item.kind.startswith('cdr:') or kind not in store.types:
            raise ValueError
        message_of(item)  # raises if it is none
        return kind, item.data
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
        from ftp_dent_ros.recording import topic

        definition = topic.find_definition(kind, topic.type_hash(kind))
        return {
            'id': len(self._channels) + 1,
            'topic': name,
            'encoding': 'cdr',
            'schemaName': kind,
            'schema': definition,
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
