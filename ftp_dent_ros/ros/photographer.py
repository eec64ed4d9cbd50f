"""Shows images on the projector and photographs them, through the payload's nodes."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from ftp_dent_ros.errors import CameraError, ImageError
from ftp_dent_ros.ros.messages import image_from_message, image_to_message, stamp_to_ns
from ftp_dent_ros.ros.qos import IMAGES, LATCHED_INPUT, PATTERNS

# Nodes find each other within so many seconds; a photograph takes at most as long as its service.
_DISCOVERY, _ANSWER = 15.0, 12.0
# One that was killed is forgotten sooner, by the middleware's own measure.
_FORGOTTEN = 25.0


class Photographer:
    """The payload's projector and camera, as two functions.

    Parameters
    ----------
    node : rclpy.node.Node
    stop : threading.Event
        Ends all waiting.
    colour : bool
        Whether photographs are RGB; grey if not.

    Attributes
    ----------
    delay_ns : int
        From the stamp of an image until it is seen.

    Raises
    ------
    CameraError
        By every method: pattern_publisher or camera_capture does not answer.
    """

    def __init__(self, node: Node, stop: threading.Event, colour: bool = False) -> None:
        self._node, self._stop, self._colour = node, stop, colour
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._shown: deque[Image] = deque(maxlen=4)
        self._taken: deque[Image] = deque(maxlen=4)
        self._show = node.create_publisher(Image, 'projector/show', LATCHED_INPUT)
        node.create_subscription(
            Image, 'projector/image_raw', lambda image: self._shown.append(image), PATTERNS
        )
        node.create_subscription(
            Image, 'camera/image_raw', lambda image: self._taken.append(image), IMAGES
        )
        self._capture = node.create_client(Trigger, 'camera_capture/capture')
        self._before: tuple[NDArray[np.uint8], NDArray[np.uint8]] | None = None
        self.delay_ns = 0

    def projector_size(self) -> tuple[int, int]:
        """Width and height of what is projected, pixels."""
        self._until(
            lambda: self._shown and self._show.get_subscription_count(),
            _DISCOVERY,
            'nothing comes on projector/image_raw: start pattern_publisher (ftp-dent up)',
        )
        self._until(
            self._capture.service_is_ready,
            _DISCOVERY,
            'nobody takes photographs: start camera_capture (ftp-dent up)',
        )
        self.alone()
        return self._shown[-1].width, self._shown[-1].height

    def alone(self) -> None:
        """Wait until nobody else shows images: photographs would be of theirs."""
        self._until(
            lambda: self._node.count_publishers('projector/show') < 2,
            _FORGOTTEN,
            'another program shows images on the projector (a calibration or preflight): end it',
        )

    def show(self, image: NDArray[np.uint8]) -> int:
        """Show RGB pixels; the time from which they are shown, nanoseconds."""
        message = image_to_message(image, self.now_ns(), 'projector')
        self._shown.clear()
        self._show.publish(message)
        self._until(
            lambda: any(each.data == message.data for each in self._shown),
            _ANSWER,
            'pattern_publisher does not show what it is asked to',
        )
        return stamp_to_ns(self._shown[-1].header.stamp)

    def projected(self) -> NDArray[np.uint8]:
        """RGB pixels that were shown last."""
        return image_from_message(self._shown[-1])

    def now_ns(self) -> int:
        """ROS time, nanoseconds."""
        return self._node.get_clock().now().nanoseconds

    def photograph(self, after_ns: int) -> tuple[NDArray[np.uint8], int]:
        """Photograph exposed after a time, and the middle of its exposure, ns."""
        trouble = 'the photographs are older than what is projected: check the stamps'
        # A camera that runs by itself may deliver photographs from before the call, and one that
        # has just started may not be ready yet.
        for _ in range(10):
            self._taken.clear()
            answer = self._capture.call_async(Trigger.Request())
            self._until(answer.done, _ANSWER, 'camera_capture does not answer')
            result = answer.result()
            if result is None or not result.success:
                why = result.message if result else 'no answer'
                trouble = f'camera_capture took no photograph: {why}'
                self.waited_for(lambda: False, 0.5)
                continue
            self._until(lambda: bool(self._taken), _ANSWER, 'no photograph arrives')
            stamp_ns = stamp_to_ns(self._taken[-1].header.stamp)
            if stamp_ns >= after_ns:
                try:
                    image = image_from_message(self._taken[-1])
                except ImageError as reason:
                    raise CameraError(f'the camera sends no photographs: {reason}') from None
                return (image if self._colour else image[..., 1].copy()), stamp_ns
            time.sleep(min(0.2, (after_ns - stamp_ns) / 1e9))
        raise CameraError(trouble)

    def take(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Show RGB pixels and photograph them once they are seen.

        On a busy computer an image may be shown later than its stamp says. A photograph in which
        nothing has changed though what is projected has is therefore taken again.
        """
        shown, seen = self._before or (image, None)
        after_ns = self.show(image) + self.delay_ns
        # An image that lights nothing in view never changes the photograph.
        for _ in range(3):
            photograph, _ = self.photograph(after_ns)
            if seen is None or np.array_equal(shown, image) or changed(seen, photograph):
                break
            after_ns = self.now_ns()
        self._before = image, photograph
        return photograph

    def waited_for(self, condition: Callable[[], object], timeout: float) -> bool:
        """Listen until a condition is met, or for so many seconds: whether it was."""
        end = time.monotonic() + timeout
        while not condition():
            if self._stop.is_set():
                raise KeyboardInterrupt
            if time.monotonic() > end:
                return False
            self._executor.spin_once(timeout_sec=0.1)
        return True

    def close(self) -> None:
        """Let the projector show its pattern again."""
        if self._node.context.ok():
            self._show.publish(Image())
            self._executor.spin_once(0.1)
        self._executor.shutdown()

    def _until(self, condition: Callable[[], object], timeout: float, trouble: str) -> None:
        if not self.waited_for(condition, timeout):
            raise CameraError(trouble)


def changed(before: NDArray[np.uint8], now: NDArray[np.uint8]) -> bool:
    """Whether the light in a photograph, grey or RGB, is another than in one before."""
    if before.shape != now.shape:
        return True
    # Means of 7x7 pixels: a camera's noise leaves a tenth of four grey levels in them.
    means = (cv2.blur(each.astype(np.float32), (7, 7)) for each in (before, now))
    return bool((cv2.absdiff(*means) > 4.0).mean() > 0.001)
