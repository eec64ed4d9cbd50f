"""Clouds and pictures as items of the link, each with a small one that goes before it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import cv2
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import View, encode, thinned
from ftp_dent_ros.errors import FtpDentError, InputError
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.protocol import Importance, Item, deflate
from ftp_dent_ros.nodes.downlink_parameters import DownlinkParameters
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.ros.diagnostics import Diagnostics
from ftp_dent_ros.ros.messages import (
    cloud_from_message,
    image_from_message,
    lens_from_message,
    stamp_to_ns,
)

# Of the link's rate, what the small ones of a kind may take up, and how often at most (s).
_PREVIEW_SHARE, _PREVIEW_PERIOD = 0.4, 0.45
# A preview's depth is coarser than a cloud's: 1.3 um at 0.8 m.
_PREVIEW_PART = 4.0
_PREVIEW_WIDTH, _PREVIEW_QUALITY = 240, 50


class Coder:
    """Codes what the downlink's worker hands to it.

    Parameters
    ----------
    given : DownlinkParameters
    put : callable
        Takes each item.
    rate : callable
        byte/s that the link carries; 0 if that is not known.
    diagnostics : Diagnostics
    """

    def __init__(
        self,
        given: DownlinkParameters,
        put: Callable[[Item], None],
        rate: Callable[[], float],
        diagnostics: Diagnostics,
    ) -> None:
        self._given, self._put, self._rate, self._diagnostics = given, put, rate, diagnostics
        self._lens: Lens | None = None
        # When the last small ones were sent, and their bytes.
        self._preview = self._picture_preview = (float('-inf'), 0)

    def learn(self, message: CameraInfo) -> None:
        """The lens that clouds and pictures are of."""
        try:
            self._lens = lens_from_message(message)
        except InputError as error:
            self._diagnostics.refuse('wrong camera_info', str(error))

    def send_cloud(self, message: PointCloud2) -> None:
        """A cloud, and a small one before it if it is time for one."""
        cloud = cloud_from_message(message)
        stamp = stamp_to_ns(message.header.stamp)
        extra = {'frame': message.header.frame_id}
        rows, columns = cloud.intensity.shape
        view = View.of(self._lens, rows, columns) if self._lens is not None else None
        if self._is_due(*self._preview):
            few, few_view = thinned(cloud, view, self._given.preview_columns)
            data = encode(Cloud(few.points, few.intensity), few_view, _PREVIEW_PART)
            self._preview = time.monotonic(), len(data)
            self._put(
                Item(Importance.PREVIEWS, topics.PREVIEW_POINTS, 'cloud', stamp, data, extra=extra)
            )
        started = time.thread_time()
        data = encode(cloud, view)
        self._diagnostics.measure('coding', time.thread_time() - started)
        self._diagnostics.count('clouds')
        self._diagnostics.note('bytes of a cloud', len(data))
        self._put(Item(Importance.CLOUDS, topics.POINTS, 'cloud', stamp, data, extra=extra))

    def send_picture(self, message: Image) -> None:
        """A picture, and a small one before it if it is time for one."""
        image = image_from_message(message)
        stamp = stamp_to_ns(message.header.stamp)
        extra = {'frame': message.header.frame_id}
        bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        if self._is_due(*self._picture_preview):
            height = round(bgr.shape[0] * _PREVIEW_WIDTH / bgr.shape[1])
            small = cv2.resize(bgr, (_PREVIEW_WIDTH, height), interpolation=cv2.INTER_AREA)
            data = _jpeg(small, _PREVIEW_QUALITY)
            self._picture_preview = time.monotonic(), len(data)
            self._put(
                Item(Importance.PREVIEWS, topics.PREVIEW_IMAGE, 'jpeg', stamp, data, extra=extra)
            )
        data = _jpeg(bgr, self._given.jpeg_quality)
        self._diagnostics.count('pictures')
        self._diagnostics.note('bytes of a picture', len(data))
        if self._lens is not None:
            extra = {**extra, 'lens': View(self._lens, 1).numbers()}
        self._put(Item(Importance.PICTURES, topics.IMAGE, 'jpeg', stamp, data, extra=extra))

    def _is_due(self, sent_at: float, size: int) -> bool:
        # By the rate as it is known now: in the beginning it is known to be far too low.
        pause = pause_after(size, self._rate(), _PREVIEW_SHARE, _PREVIEW_PERIOD)
        return time.monotonic() >= sent_at + pause


class Thrift:
    """Items that each take the place of the one before, as often as a share of the link allows.

    Parameters
    ----------
    put : callable
        Takes each item.
    rate : callable
        byte/s that the link carries; 0 if that is not known.
    """

    def __init__(self, put: Callable[[Item], None], rate: Callable[[], float]) -> None:
        self._put, self._rate = put, rate
        self._due: dict[str, float] = {}
        self._waiting: dict[str, tuple[Item, float]] = {}

    def put(self, item: Item, share: float) -> None:
        """Send an item, or keep it until its topic's next is due."""
        self._waiting[item.topic] = item, share
        self.flush()

    def flush(self) -> None:
        """Send what is due."""
        now = time.monotonic()
        for topic, (item, share) in list(self._waiting.items()):
            if now >= self._due.get(topic, 0.0):
                del self._waiting[topic]
                size = len(deflate(item.data))
                self._due[topic] = now + pause_after(size, self._rate(), share, 0.0)
                self._put(item)


def pause_after(size: int, rate: float, share: float, least: float) -> float:
    """Seconds until the next one of such a size, so that they take that share of the link."""
    return max(least, size / (share * rate)) if rate else least


def _jpeg(bgr: Any, quality: int) -> bytes:
    done, data = cv2.imencode('.jpg', bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise FtpDentError('a picture could not be compressed: look at its size')
    return data.tobytes()
