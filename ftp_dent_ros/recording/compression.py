"""Clouds and pictures of a bag in a tenth of their size, on request.

A cloud or picture of the topic ``NAME`` is stored as a ``sensor_msgs/msg/CompressedImage`` of the
topic ``NAME/coded_cloud`` or ``NAME/coded_image``, so that the bag stays one that every tool
reads: colours of 8 bits as PNG or JPEG, whichever is shorter, grey and raw pixels as PNG, to the
last bit, clouds as `coding.cloud_codec` has them.
What this package reads of such a bag has its names, types and messages back: clouds to half of
their own uncertainty, pictures as JPEG leaves them.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import cv2
import numpy as np

from ftp_dent_ros.coding.cloud_codec import VERSION, RayGrid, decode, encode
from ftp_dent_ros.coding.images import image_from_message, photograph_from_message
from ftp_dent_ros.coding.messages import CLOUD_FIELDS, cloud_from_message, lens_from_message
from ftp_dent_ros.errors import BagError, InputError
from ftp_dent_ros.recording.topic import (
    CODED,
    CODED_TYPE,
    Message,
    RecordedTopic,
    deserialise,
    known_topic,
    typestore,
)
from ftp_dent_ros.recording.writer import BagWriter
from ftp_dent_ros.rig.rig import Lens

_CLOUD, _IMAGE = CODED.values()
_SUFFIXES = {kind: suffix for suffix, kind in CODED.items()}
_INFO = 'sensor_msgs/msg/CameraInfo'
_FLOAT32 = 7  # of sensor_msgs/PointField
_FORMAT = re.compile(r'ftp_dent_ros cloud (\d+), (\d) fields|ftp_dent_ros (\w+), (?:jpeg|png)')
# Of one level a pixel: JPEG would mix a mosaic's colours, and has eight bits.
_LOSSLESS = re.compile('(?:mono|bayer_....)(?:8|16)')
_QUICKLY = (cv2.IMWRITE_PNG_COMPRESSION, 1)


class CompressedBagWriter(BagWriter):
    """A `BagWriter` that codes clouds and pictures; what cannot be coded is stored as it is."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._given: dict[str, RecordedTopic] = {}
        self._lenses: dict[str, Lens | None] = {}

    def add_topic(self, topic: RecordedTopic) -> None:
        """As `BagWriter.add_topic`; how a cloud or picture is stored its messages say."""
        if topic.type in (_CLOUD, _IMAGE):
            self._given.setdefault(topic.name, topic)
        else:
            super().add_topic(topic)

    def write(self, messages: Iterable[Message]) -> None:
        """As `BagWriter.write`."""
        super().write(map(self._coded, messages))

    def _coded(self, message: Message) -> Message:
        topic = self._given.get(message.topic)
        try:
            if message.type == _INFO:
                info = deserialise(message.data, _INFO)
                self._lenses[info.header.frame_id] = lens_from_message(info)
            if topic is None:
                return message
            given = deserialise(message.data, message.type)
            code = self._code_cloud if message.type == _CLOUD else self._code_picture
            form, data = code(given)
        except (InputError, ValueError, TypeError, AssertionError, KeyError, cv2.error):
            if topic is not None:
                super().add_topic(topic)
            return message
        store = typestore()
        coded = store.types[CODED_TYPE](
            header=given.header, format=form, data=np.frombuffer(data, np.uint8)
        )
        name = f'{topic.name}{_SUFFIXES[topic.type]}'
        super().add_topic(known_topic(name, CODED_TYPE, topic.offered_qos))
        raw = bytes(store.serialize_cdr(coded, CODED_TYPE))
        return message._replace(topic=name, type=CODED_TYPE, data=raw)

    def _code_cloud(self, message: Any) -> tuple[str, bytes]:
        count = len(message.fields)
        given = [(each.name, each.datatype, each.offset) for each in message.fields]
        plain = [(name, _FLOAT32, 4 * k) for k, name in enumerate(CLOUD_FIELDS[:count])]
        dense = message.point_step == 4 * count and message.row_step == 4 * count * message.width
        if not (given == plain and count >= 4 and dense and message.height > 1):
            raise ValueError('a cloud of another layout')
        cloud = cloud_from_message(message)
        lens = self._lenses.get(message.header.frame_id)
        view = RayGrid.of(lens, message.height, message.width) if lens is not None else None
        return f'ftp_dent_ros cloud {VERSION}, {count} fields', encode(cloud, view)

    def _code_picture(self, message: Any) -> tuple[str, bytes]:
        if _LOSSLESS.fullmatch(message.encoding):
            pixels = photograph_from_message(message).pixels
            return f'ftp_dent_ros {message.encoding}, png', _encoded(pixels, '.png', _QUICKLY)
        if message.encoding not in ('rgb8', 'bgr8'):
            raise ValueError('a picture of another kind')
        bgr = np.ascontiguousarray(image_from_message(message)[..., ::-1])
        # A projector's pattern is small as PNG, and must be exact.
        few = bgr[:: max(1, bgr.shape[0] // 16)]
        form, options = '.jpg', [cv2.IMWRITE_JPEG_QUALITY, 90]
        if len(_encoded(few, '.png', [])) < len(_encoded(few, '.jpg', options)):
            form, options = '.png', []
        name = 'png' if form == '.png' else 'jpeg'
        return f'ftp_dent_ros rgb8, {name}', _encoded(bgr, form, options)


def decoded(message: Message, name: str) -> Message:
    """Message as it was recorded, under the topic's name.

    Raises
    ------
    BagError
        It is damaged.
    """
    store = typestore()
    try:
        given = deserialise(message.data, CODED_TYPE)
        match = _FORMAT.fullmatch(given.format)
        if match is None:
            raise BagError(f'{message.topic} holds {given.format!r}, which is not known here')
        kind = _CLOUD if match[1] else _IMAGE
        data = bytes(given.data)
        plain = (
            cloud_message(given.header, data, int(match[2]))
            if match[1]
            else _image(given.header, data, match[3])
        )
    except (InputError, ValueError, AssertionError, cv2.error) as reason:
        raise BagError(f'a message of {message.topic} is damaged ({reason})') from None
    raw = bytes(store.serialize_cdr(plain, kind))
    return message._replace(topic=name, type=kind, data=raw)


def cloud_message(header: Any, data: bytes, count: int) -> Any:
    """sensor_msgs/PointCloud2, without ROS, of an encoded cloud's first `count` fields."""
    cloud = decode(data)
    types = typestore().types
    rows, columns = cloud.intensity.shape
    values = np.empty((rows, columns, count), '<f4')
    values[..., :3] = cloud.points
    for index, name in enumerate(CLOUD_FIELDS[3:count], start=3):
        values[..., index] = getattr(cloud, name)
    field = types['sensor_msgs/msg/PointField']
    return types[_CLOUD](
        header=header,
        height=rows,
        width=columns,
        fields=[
            field(name=name, offset=4 * index, datatype=_FLOAT32, count=1)
            for index, name in enumerate(CLOUD_FIELDS[:count])
        ],
        is_bigendian=False,
        point_step=4 * count,
        row_step=4 * count * columns,
        data=values.reshape(-1).view(np.uint8),
        is_dense=False,
    )


def _image(header: Any, data: bytes, encoding: str) -> Any:
    colours = not _LOSSLESS.fullmatch(encoding)
    size = 2 if encoding.endswith('16') else 1
    how = cv2.IMREAD_COLOR if colours else cv2.IMREAD_UNCHANGED
    image: Any = cv2.imdecode(np.frombuffer(data, np.uint8), how)
    whole = image is not None and (colours or (image.ndim, image.itemsize) == (2, size))
    if not whole:
        raise ValueError('no picture')
    pixels = np.ascontiguousarray(image[..., ::-1] if colours else image)
    return typestore().types[_IMAGE](
        header=header,
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=int(sys.byteorder == 'big' and pixels.itemsize > 1),
        step=pixels[0].nbytes,
        data=pixels.reshape(-1).view(np.uint8),
    )


def _encoded(bgr: Any, form: str, options: Sequence[int]) -> bytes:
    done, data = cv2.imencode(form, bgr, list(options))
    if not done:
        raise ValueError('a picture that cannot be compressed')
    return data.tobytes()
