"""Publishes the fringe pattern, the one that the projector shows and everything else reads.

Latched ``projector/image_raw`` (rgb8) holds exactly the pixels to project, and
``projector/camera_info`` the projector's intrinsics. It can also show the pattern itself, on a
projector that is this computer's second display.
"""

from __future__ import annotations

import dataclasses
import os
import sys
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern import Pattern, read_pattern
from ftp_dent_ros.rig import Rig, read_rig
from ftp_dent_ros.ros.diagnostics import ERROR, OK, Diagnostics
from ftp_dent_ros.ros.messages import camera_info_message, image_to_message
from ftp_dent_ros.ros.node import run
from ftp_dent_ros.ros.parameters import Parameters
from ftp_dent_ros.ros.qos import LATCHED


class PatternPublisher(Node):
    """Node that draws and publishes the pattern; its period and stripe can be changed."""

    def __init__(self, **options: Any) -> None:
        super().__init__('pattern_publisher', **options)
        parameters = Parameters(self)
        rig = parameters.declare(
            'rig', '', 'Calibration file (rig.yaml), or the name of a shipped one.'
        )
        pattern = parameters.declare(
            'pattern',
            '',
            'Pattern file (pattern.yaml), or the name of a shipped one; if empty, the size is '
            "that of the rig's projector and period_px must be set.",
        )
        parameters.declare(
            'period_px',
            0.0,
            'Fringe period, projector pixels; 0 takes that of the pattern file.',
            minimum=0.0,
            maximum=1e4,
            changeable=True,
        )
        parameters.declare(
            'stripe_center_px',
            0.0,
            'Column of the middle of the red stripe, projector pixels; 0 takes that of the '
            "pattern file or, without one, the image's middle.",
            minimum=0.0,
            maximum=65536.0,
            changeable=True,
        )
        self._frame_id = parameters.declare(
            'frame_id', 'projector_optical_frame', "The projector's frame."
        )
        show = parameters.declare(
            'display.enabled', False, 'Show the pattern in full screen on a display.'
        )
        corner = [
            parameters.declare(
                f'display.{axis}',
                0,
                f"{axis} of the display's upper left corner on the desktop, pixels.",
                minimum=-65536,
                maximum=65536,
            )
            for axis in 'xy'
        ]
        self._rig: Rig | None = read_rig(find(rig)) if rig else None
        self._base = read_pattern(find(pattern)) if pattern else None
        self._pattern = self._make(parameters['period_px'], parameters['stripe_center_px'])
        self._image = self.create_publisher(Image, 'projector/image_raw', LATCHED)
        self._info = self.create_publisher(CameraInfo, 'projector/camera_info', LATCHED)
        self._diagnostics = Diagnostics(self, self._judge)
        self._display: Display | None = None
        if show:
            self._display = Display(
                corner[0], corner[1], (self._pattern.width, self._pattern.height)
            )
            self.create_timer(0.1, self._display.refresh)
        self._settings = parameters
        parameters.on_change(self._change)
        self._publish()

    def destroy_node(self) -> None:
        """Close the window, too."""
        if self._display:
            self._display.close()
        super().destroy_node()

    def _make(self, period_px: float, stripe_center_px: float) -> Pattern:
        """Pattern of the file or the rig's projector, with these values where they are not 0."""
        base = self._base
        if base is None:
            if self._rig is None:
                raise ConfigurationError(
                    'the size of the pattern is not known: set the parameter pattern or rig'
                )
            if not period_px:
                raise ConfigurationError(
                    'the period of the pattern is not known: set the parameter pattern or '
                    'period_px'
                )
            size = self._rig.projector
            base = Pattern(size.width, size.height, period_px, (size.width - 1) / 2)
        pattern = dataclasses.replace(
            base,
            period_px=period_px or base.period_px,
            stripe_center_px=stripe_center_px or base.stripe_center_px,
        )
        if self._rig:
            pattern.check_fits(self._rig.projector)
        return pattern

    def _change(self, values: dict[str, Any]) -> None:
        period, stripe = (
            values.get(name, self._settings[name]) for name in ('period_px', 'stripe_center_px')
        )
        self._pattern = self._make(period, stripe)
        self._publish()

    def _publish(self) -> None:
        pattern, now_ns = self._pattern, self.get_clock().now().nanoseconds
        image = pattern.draw()
        self._image.publish(image_to_message(image, now_ns, self._frame_id))
        lens = self._rig.projector if self._rig else None
        size = (pattern.width, pattern.height)
        self._info.publish(camera_info_message(lens, size, now_ns, self._frame_id))
        if self._display:
            self._display.show(image)
        self._diagnostics.count('patterns')
        self._diagnostics.note('period (px)', f'{pattern.period_px:g}')
        self._diagnostics.note('stripe centre (px)', f'{pattern.stripe_center_px:g}')
        self._diagnostics.note('size', f'{pattern.width}x{pattern.height}')
        self.get_logger().info(
            f'pattern of {pattern.width}x{pattern.height} pixels, period {pattern.period_px:g}, '
            f'stripe at {pattern.stripe_center_px:g}'
        )

    def _judge(self) -> tuple[bytes, str]:
        if self._display and self._display.trouble:
            return ERROR, self._display.trouble
        shown = 'shown and published' if self._display else 'published'
        return OK, f'{shown}, {self._image.get_subscription_count()} subscribers'


class Display:
    """A window in full screen whose pixels are the pattern's.

    Parameters
    ----------
    x, y : int
        Upper left corner of the display on the desktop, pixels.
    size : (int, int)
        Width and height of the pattern.

    Raises
    ------
    ConfigurationError
        There is no desktop, or this OpenCV has no windows.
    """

    _NAME = 'ftp_dent_ros pattern'

    def __init__(self, x: int, y: int, size: tuple[int, int]) -> None:
        self.trouble = ''
        self._corner = x, y
        self._size = size
        self._shown: NDArray | None = None
        # Without a desktop some builds of OpenCV end the process instead of raising.
        if not (os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')):
            raise ConfigurationError(
                'display.enabled is set, but this process has no desktop (DISPLAY is not set): '
                'start it in a graphical session or show projector/image_raw elsewhere'
            )
        try:
            self._open()
        except cv2.error as reason:
            raise ConfigurationError(
                f'display.enabled is set, but OpenCV {cv2.__version__} opens no window here '
                f'({reason.err.split(".")[0]}): install an OpenCV that is not headless'
            ) from None

    def show(self, image: NDArray[np.uint8]) -> None:
        """Show RGB pixels."""
        self._shown = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        cv2.imshow(self._NAME, self._shown)

    def refresh(self) -> None:
        """Serve the window, and open it again if it was closed."""
        cv2.waitKey(1)
        if cv2.getWindowProperty(self._NAME, cv2.WND_PROP_VISIBLE) < 1:
            self._open()
            if self._shown is not None:
                cv2.imshow(self._NAME, self._shown)
        _, _, *size = cv2.getWindowImageRect(self._NAME)
        self.trouble = ''
        if tuple(size) != self._size:
            self.trouble = (
                f'the display shows {size[0]}x{size[1]} pixels, the pattern has '
                f"{self._size[0]}x{self._size[1]}: set the display to the projector's resolution"
            )

    def close(self) -> None:
        """Close the window."""
        cv2.destroyAllWindows()

    def _open(self) -> None:
        # Of the pattern's size: where no window manager serves, nothing makes it fill the screen.
        bare = cv2.WINDOW_NORMAL | cv2.WINDOW_FREERATIO | cv2.WINDOW_GUI_NORMAL
        cv2.namedWindow(self._NAME, bare)
        cv2.resizeWindow(self._NAME, *self._size)
        cv2.moveWindow(self._NAME, *self._corner)
        cv2.setWindowProperty(self._NAME, cv2.WND_PROP_FULLSCREEN, cv2.WINDOW_FULLSCREEN)


def main() -> int:
    """Run the node as a process."""
    return run(PatternPublisher, 'pattern_publisher')


if __name__ == '__main__':
    sys.exit(main())
