"""What comes to the ground as a Foxglove WebSocket, without ROS."""

from __future__ import annotations

from typing import Any

import numpy as np

from ftp_dent_ros.errors import CodecError, ConfigurationError
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.page.scene import message_of
from ftp_dent_ros.ground.protocol import Item

_PICTURE, _CLOUD = 'sensor_msgs/msg/CompressedImage', 'sensor_msgs/msg/PointCloud2'
_FIELDS = 6  # of a cloud: x, y, z, intensity, sigma, resolution
_NAMES = {topics.IMAGE: f'{topics.IMAGE}/compressed'}


class FoxgloveServer:
    """Serves items as the messages that they were.

    Parameters
    ----------
    address : str
        ``HOST:PORT``.

    Raises
    ------
    ConfigurationError
        foxglove-sdk or rosbags is not installed, or the address cannot be listened on.
    """

    def __init__(self, address: str) -> None:
        try:
            import foxglove

            from ftp_dent_ros.recording import definitions
        except ModuleNotFoundError as missing:
            raise ConfigurationError(
                f'the Foxglove WebSocket needs {missing.name}, which is not installed: install it '
                "with `pip install '.[ground,bags]'`"
            ) from None
        self._foxglove: Any = foxglove
        self._definitions: Any = definitions
        host, _, port = address.rpartition(':')
        try:
            self._context = foxglove.Context()
            self._server = foxglove.start_server(
                name='ftp_dent_ros',
                host=host or '127.0.0.1',
                port=int(port),
                context=self._context,
            )
        except (OSError, RuntimeError, ValueError, OverflowError) as reason:
            raise ConfigurationError(
                f'{address}: the Foxglove WebSocket cannot be served there ({reason}): give '
                'HOST:PORT'
            ) from None
        self.url = f'ws://{host or "127.0.0.1"}:{self._server.port}'
        self._channels: dict[str, Any] = {}

    def take(self, item: Item) -> None:
        """Pass an item on.

        Raises
        ------
        CodecError
            It is not what it says.
        """
        try:
            kind, data = self._message(item)
        except (ValueError, TypeError, KeyError):
            raise CodecError(f'an item of {item.topic} is malformed: it is refused') from None
        self._channel(item.topic, kind).log(data, log_time=item.stamp_ns)

    def close(self) -> None:
        """End all connections."""
        self._server.stop()

    def _message(self, item: Item) -> tuple[str, bytes]:
        """Type and serialised message of an item."""
        frame = str(item.extra.get('frame', ''))
        if item.kind == 'cloud':
            from ftp_dent_ros.recording.compression import cloud_message

            message = cloud_message(self._header(item.stamp_ns, frame), item.data, _FIELDS)
            return _CLOUD, self._serialised(message, _CLOUD)
        if item.kind == 'jpeg':
            store = self._definitions.typestore()
            picture = store.types[_PICTURE](
                header=self._header(item.stamp_ns, frame),
                format='jpeg',
                data=np.frombuffer(item.data, np.uint8),
            )
            return _PICTURE, self._serialised(picture, _PICTURE)
        kind = item.kind.removeprefix('cdr:')
        if not item.kind.startswith('cdr:') or kind not in self._definitions.typestore().types:
            raise ValueError
        message_of(item)  # raises if it is none
        return kind, item.data

    def _header(self, stamp_ns: int, frame: str) -> Any:
        types = self._definitions.typestore().types
        seconds, rest = divmod(stamp_ns, 10**9)
        stamp = types['builtin_interfaces/msg/Time'](sec=seconds, nanosec=rest)
        return types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame)

    def _serialised(self, message: Any, kind: str) -> bytes:
        return bytes(self._definitions.typestore().serialize_cdr(message, kind))

    def _channel(self, topic: str, kind: str) -> Any:
        name = '/' + _NAMES.get(topic, topic).lstrip('/')
        channel = self._channels.get(name)
        if channel is None:
            code = self._definitions.type_hash(kind)
            text = self._definitions.find_definition(kind, code).text
            schema = self._foxglove.Schema(name=kind, encoding='ros2msg', data=text.encode())
            channel = self._channels[name] = self._foxglove.Channel(
                name, schema=schema, message_encoding='cdr', context=self._context
            )
        return channel
