"""Publishes the fringe pattern, the one that the projector shows and everything else reads.

Latched ``projector/image_raw`` (rgb8) holds exactly the pixels to project, and
``projector/camera_info`` the projector's intrinsics. It can also show the pattern itself, on a
projector that is a display of this computer, with a desktop or without one.

The stamp is the time from which on the pattern is shown. A change is published a little before it
is shown, so that no photograph of it can be faster than the message. Images of ``projector/show``
(a calibration's, say) are shown and published in the pattern's stead, until an empty one or half
a minute without any.
"""

from __future__ import annotations

import dataclasses
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from ftp_dent_ros.errors import ConfigurationError, ImageError
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import PatternPublisherSettings
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.ros.diagnostics import ERROR, OK, WARN, Verdict
from ftp_dent_ros.ros.messages import camera_info_message, image_from_message, image_to_message
from ftp_dent_ros.ros.qos import LATCHED, LATCHED_INPUT, PATTERNS
from ftp_dent_ros.window import Window

# Seconds between looks at what is due on the display: less than a frame of 60 Hz.
_TICK = 0.01
_CHANGEABLE = 'period_px', 'stripe_center_px', 'code'


class PatternPublisher(PayloadNode[PatternPublisherSettings]):
    """Node that draws and publishes the pattern; its period and stripe can be changed."""

    def _set_up(self) -> None:
        given = self.given
        self._pattern = self._make(*(getattr(given, name) for name in _CHANGEABLE))
        self._image = self.create_publisher(Image, 'projector/image_raw', PATTERNS)
        self._info = self.create_publisher(CameraInfo, 'projector/camera_info', LATCHED)
        self._display: Window | None = None
        self._waiting: deque[tuple[int, NDArray[np.uint8]]] = deque()
        if given.shows:
            size = self._pattern.width, self._pattern.height
            self._display = Window(given.x, given.y, size)
            self.ending.callback(self._display.close)
            self.create_timer(0.1, self._display.refresh)
            self.create_timer(_TICK, self._show)
        self._shown_until: float | None = None
        self.hear(Image, 'projector/show', self._on_show, LATCHED_INPUT)
        self.create_timer(0.5, self._return)
        self.settings.on_change(self._change)
        self._publish()

    def _make(self, period_px: float, stripe_center_px: float, code: str) -> Pattern:
        """Pattern of the file or the rig's projector, with these values where they are given."""
        base = self.given.pattern
        if base is None:
            if self.given.rig is None:
                raise ConfigurationError(
                    'the size of the pattern is not known: set the parameter pattern or rig'
                )
            if not period_px:
                raise ConfigurationError(
                    'the period of the pattern is not known: set the parameter pattern or '
                    'period_px'
                )
            size = self.given.rig.projector
            base = Pattern(size.width, size.height, period_px, (size.width - 1) / 2)
        pattern = dataclasses.replace(
            base,
            period_px=period_px or base.period_px,
            stripe_center_px=stripe_center_px or base.stripe_center_px,
            code=base.code if code == 'file' else code,
        )
        if self.given.rig:
            pattern.check_fits(self.given.rig.projector)
        return pattern

    def _change(self, values: dict[str, Any]) -> None:
        pattern = self._make(*(values.get(name, self.settings[name]) for name in _CHANGEABLE))
        # What is shown already keeps its stamp.
        if pattern != self._pattern:
            self._pattern = pattern
            # Nanoseconds between a change's message and its show: many times what a message of
            # this size takes within a computer (10 ms; 60 ms over a network of 400 Mbit/s).
            self._publish(200_000_000)

    def _publish(self, ahead_ns: int = 0) -> None:
        """Publish the pattern, and show it so many nanoseconds later."""
        pattern, image = self._pattern, self._pattern.draw()
        stamp_ns = self.now_ns() + ahead_ns
        lens = self.given.rig.projector if self.given.rig else None
        size = (pattern.width, pattern.height)
        self._info.publish(camera_info_message(lens, size, stamp_ns, self.given.frame_id))
        self._put(image, stamp_ns)
        self.diagnostics.count('patterns')
        self.diagnostics.note(
            {
                'period (px)': f'{pattern.period_px:g}',
                'stripe centre (px)': f'{pattern.stripe_center_px:g}',
                'code': pattern.code,
                'size': f'{pattern.width}x{pattern.height}',
            }
        )
        self.get_logger().info(
            f'pattern of {pattern.width}x{pattern.height} pixels, period {pattern.period_px:g}, '
            f'{pattern.code} code, centre at {pattern.stripe_center_px:g}'
        )

    def _on_show(self, message: Image) -> None:
        """Show somebody's image instead of the pattern, for a while; an empty one ends it."""
        if not message.width:
            self._shown_until = time.monotonic()
            self._return()
            return
        image = image_from_message(message)
        size = self._pattern.width, self._pattern.height
        if image.shape[1::-1] != size:
            raise ImageError(
                f'an image of {image.shape[1]}x{image.shape[0]} pixels was to be shown by a '
                f'projector of {size[0]}x{size[1]}'
            )
        # Seconds after which an image that nothing follows gives way to the pattern.
        self._shown_until = time.monotonic() + 30.0
        self._put(image, self.now_ns())
        self.diagnostics.count('images shown')

    def _put(self, image: NDArray[np.uint8], stamp_ns: int) -> None:
        """Tell of what is shown from a time on, and show it then."""
        self._image.publish(image_to_message(image, stamp_ns, self.given.frame_id))
        if self._display:
            self._waiting.append((stamp_ns, image))
            self._show()

    def _return(self) -> None:
        """Go back to the pattern once nobody shows anything else."""
        if self._shown_until is not None and time.monotonic() >= self._shown_until:
            self._shown_until = None
            self._publish()

    def _show(self) -> None:
        """Show what is due."""
        now_ns = self.now_ns()
        while self._display and self._waiting and self._waiting[0][0] <= now_ns:
            self._display.show(self._waiting.popleft()[1])

    def _judge(self) -> Sequence[Verdict]:
        trouble = self._display.trouble if self._display else ''
        does = 'shown and published' if self._display else 'published'
        others = 'shows the images of projector/show, not the pattern'
        return (
            (trouble, ERROR, trouble),
            (self._shown_until is not None, WARN, others),
            (True, OK, f'{does}, {self._image.get_subscription_count()} subscribers'),
        )
