"""Publishes photographs: of a V4L2 camera, of image files, or of the simulated rig.

An image is stamped with the middle of its exposure, and ``camera/camera_info`` has the same
stamp. ``~/capture`` takes one photograph on demand; with ``rate`` 0 or without ``continuous``
that is the only way to one. A device is read whether anybody listens or not; files and the
simulation stand still while nobody does.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial
from pathlib import Path

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.duration import Duration
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from ftp_dent_ros.capture.device import DeviceSource, open_device
from ftp_dent_ros.capture.source import (
    ExposureClock,
    FileSource,
    Frame,
    RenderedSource,
    SimulatedSource,
    Source,
    stamps_exposure_start,
)
from ftp_dent_ros.errors import ConfigurationError, ImageError
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import CameraCaptureSettings
from ftp_dent_ros.ros.diagnostics import OK, WARN, Verdict
from ftp_dent_ros.ros.messages import (
    camera_info_message,
    image_from_message,
    image_to_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import IMAGES, OVERRIDABLE, PATTERNS

# Seconds: until a photograph on demand, between two looks at whether to stop, and after a reader
# has come.
_DEMAND_TIMEOUT = 10.0
_PAUSE = 0.1
# That the readers of the last photograph are given, at most.
_ACKNOWLEDGED = Duration(seconds=1.5)


class CameraCapture(PayloadNode[CameraCaptureSettings]):
    """Node that takes photographs in a thread of its own and publishes them."""

    threads = 2

    def _set_up(self) -> None:
        given = self.given
        self._source: Source = make_source(given, self.now_ns)
        self._image = self.create_publisher(
            Image, 'camera/image_raw', IMAGES, qos_overriding_options=OVERRIDABLE
        )
        self._info = self.create_publisher(
            CameraInfo, 'camera/camera_info', IMAGES, qos_overriding_options=OVERRIDABLE
        )
        self.diagnostics.hardware_id = given.path if given.source == 'device' else given.source
        self._missed_before = 0
        self._was_wanted = False
        if isinstance(self._source, SimulatedSource):
            project = partial(self._on_projected, self._source)
            self.hear(Image, 'projector/image_raw', project, PATTERNS, 'wrong pattern')
        # It waits for the photograph, in the executor's second thread.
        self.create_service(
            Trigger, '~/capture', self._on_capture, callback_group=MutuallyExclusiveCallbackGroup()
        )
        # What a reader has not got of the last photograph ends with its publisher.
        for publisher in (self._image, self._info):
            self.ending.callback(publisher.wait_for_all_acked, _ACKNOWLEDGED)
        self._stop = threading.Event()
        # What is demanded has its turn between two looks at what is due.
        self._thread = ThreadPoolExecutor(1, 'capture')
        self._thread.submit(self._look)
        self.ending.callback(self._thread.shutdown, cancel_futures=True)
        self.ending.callback(self._source.close)
        self.ending.callback(self._stop.set)

    def _on_projected(self, source: SimulatedSource, message: Image) -> None:
        source.project(image_from_message(message), stamp_to_ns(message.header.stamp))

    def _on_capture(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        demand = self._thread.submit(self._shoot)
        if not wait([demand], _DEMAND_TIMEOUT).done:
            demand.cancel()
            response.message = f'no photograph within {_DEMAND_TIMEOUT:g} s'
        elif (error := demand.exception()) is not None:
            response.message = str(error)
            with self.diagnostics.guarded('no photograph'):
                raise error
        elif (frame := demand.result()) is None:
            response.message = 'there are no more images: set files.loop, or start again'
        else:
            seconds, nanoseconds = divmod(frame.stamp_ns, 1_000_000_000)
            response.success = True
            response.message = f'photograph taken at {seconds}.{nanoseconds:09d}'
        return response

    def _shoot(self) -> Frame | None:
        """Publish a photograph on demand; None if there are no more."""
        frame = self._source.shoot()
        if frame is not None:
            self._publish(frame)
        return frame

    def _look(self) -> None:
        """Publish the photograph that is due, if there is one for the moment, and look again."""
        with self.diagnostics.guarded('no photograph'):
            try:
                self._publish_due()
            except ImageError:
                raise
            except Exception:
                self._stop.wait(_PAUSE)
                raise
        if not self._stop.is_set():
            self._thread.submit(self._look)

    def _publish_due(self) -> None:
        running = self.settings['continuous'] and self.given.rate > 0 and not self._source.finished
        wanted = running and (self._source.runs_by_itself or self._is_heard())
        if wanted and self._was_wanted:
            frame = self._source.next_frame(_PAUSE)
            if frame is not None:
                self._publish(frame)
            return
        # A subscriber that has just been found may not have found this publisher yet.
        self._stop.wait(0.3 if wanted else _PAUSE / 5)
        self._source.rest()
        self._was_wanted = wanted

    def _is_heard(self) -> bool:
        return bool(self._image.get_subscription_count() or self._info.get_subscription_count())

    def _publish(self, frame: Frame) -> None:
        photograph = frame.photograph
        width, height = photograph.width, photograph.height
        if self._image.get_subscription_count():
            self._image.publish(image_to_message(photograph, frame.stamp_ns, self.given.frame_id))
        lens = self.given.rig.camera if self.given.rig else None
        self._info.publish(
            camera_info_message(lens, (width, height), frame.stamp_ns, self.given.frame_id)
        )
        self.diagnostics.count('images')
        self.diagnostics.note({'size': f'{width}x{height}', 'pixels': photograph.encoding})
        self.diagnostics.count('latency', (self.now_ns() - frame.stamp_ns) / 1e9)

    def _judge(self) -> Sequence[Verdict]:
        source, rate = self._source, self.given.rate
        missed, self._missed_before = source.missed - self._missed_before, source.missed
        self.diagnostics.note(source.notes())
        on_demand = not self.settings['continuous'] or rate == 0
        is_idle = not source.runs_by_itself and not self._is_heard()
        late = f'cannot keep up with {rate:g} images a second: lower the rate'
        return (
            (source.finished, OK, 'all images have been published'),
            (on_demand, OK, 'waiting for a call of ~/capture'),
            (missed, WARN, late),
            (is_idle, OK, 'idle: nobody subscribes to the images'),
        )


def make_source(given: CameraCaptureSettings, now_ns: Callable[[], int]) -> Source:
    """Make the source, on ROS time in nanoseconds."""
    rig, rate = given.rig, given.rate
    if given.source == 'device':
        device, stamps = given.asked(), given.stamps
        if not device.width or not device.height:
            raise ConfigurationError(
                'the size of the images is not known: set rig, or device.width and device.height'
            )
        at_start = stamps == 'start' or (stamps == 'auto' and stamps_exposure_start(device.path))
        clock = ExposureClock(device.exposure, at_start, given.stamp_offset)
        return DeviceSource(partial(open_device, device), rate, clock, now_ns)
    if given.source == 'genicam':
        # Imported only here: others need no Aravis.
        from ftp_dent_ros.capture.aravis import GenicamCapture

        clock = ExposureClock(given.exposure, given.stamps != 'end', given.stamp_offset)
        return DeviceSource(partial(GenicamCapture, given.asked()), rate, clock, now_ns)
    if given.source == 'files':
        size = (rig.camera.width, rig.camera.height) if rig else None
        return FileSource(given.files, rate, given.loop, size, now_ns, given.encoding)
    if rig is None or given.scene is None:
        lacking = 'rig' if rig is None else 'simulation.scene'
        raise ConfigurationError(
            f'the simulation needs its {lacking}: set the parameter {lacking}'
        )
    if given.ahead:
        return RenderedSource(Path(given.ahead), rate, given.start_ns, now_ns)
    # Imported only here: a real camera needs none of it.
    from ftp_dent_ros.simulation.world import LiveWorld

    world = LiveWorld(given.scene, given.start_ns)
    return SimulatedSource(partial(world.photograph, rig), rate, now_ns)
