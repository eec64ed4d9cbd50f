"""Photographs in, point clouds out.

Period and stripe are read out of ``projector/image_raw``; the calibration is the parameter
``rig``. Nothing is computed while nobody subscribes to ``points``; of the images that arrive
while one is worked on only the newest is kept. A photograph that gives no cloud is refused with
its reason, in the log and on ``/diagnostics``.
"""

from __future__ import annotations

import contextlib
import dataclasses
import sys
import traceback
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from ftp_dent_ros.errors import (
    ImageError,
    InputError,
    NoCalibrationError,
    NoPatternError,
    PatternError,
    RefusedFrameError,
    RigError,
    WrongCalibrationError,
)
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern import Pattern, pattern_from_image
from ftp_dent_ros.profilometry import METHODS, UNWRAPPINGS, Reconstructor, Settings
from ftp_dent_ros.rig import Lens, read_rig
from ftp_dent_ros.ros.diagnostics import OK, WARN, Diagnostics
from ftp_dent_ros.ros.messages import (
    cloud_to_message,
    image_from_message,
    lens_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.node import run
from ftp_dent_ros.ros.parameters import Parameters
from ftp_dent_ros.ros.qos import CLOUDS, IMAGES, LATCHED, OVERRIDABLE
from ftp_dent_ros.ros.worker import NewestWorker

# A longer time since the exposure is no latency: the images come from a recording.
_LONGEST_LATENCY = 60.0


class Reconstruction(Node):
    """Node that turns each photograph into an organised cloud of the same stamp and frame."""

    def __init__(self, **options: Any) -> None:
        super().__init__('reconstruction', **options)
        parameters = Parameters(self)
        rig = parameters.declare(
            'rig',
            '',
            'Calibration file (rig.yaml), or the name of a shipped one; without it every image '
            'is refused.',
        )
        self._tolerance_px = parameters.declare(
            'camera_info_tolerance',
            5.0,
            "Pixels by which a ray may differ between camera_info and the rig's camera; beyond "
            'it images are refused.',
            minimum=0.0,
            maximum=1e4,
        )
        self._settings = _declare_settings(parameters)
        parameters.on_change(self._change)
        self._rig = read_rig(find(rig)) if rig else None
        self._pattern: Pattern | None = None
        self._pattern_trouble = 'nothing came on the pattern topic yet: start pattern_publisher'
        self._calibration_trouble = ''
        self._checked: tuple[Any, ...] = ()
        self._prepared: tuple[Pattern, Settings, Reconstructor] | None = None
        self._points = self.create_publisher(
            PointCloud2, 'points', CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        self._diagnostics = Diagnostics(self, self._judge)
        self._worker = NewestWorker(self._work, 'reconstruction')
        self.create_subscription(Image, 'projector/image_raw', self._on_pattern, LATCHED)
        self.create_subscription(
            CameraInfo,
            'camera/camera_info',
            self._on_info,
            IMAGES,
            qos_overriding_options=OVERRIDABLE,
        )
        self.create_subscription(
            Image,
            'camera/image_raw',
            self._on_image,
            IMAGES,
            qos_overriding_options=OVERRIDABLE,
        )

    def destroy_node(self) -> None:
        """Finish the image in work first."""
        self._worker.stop()
        super().destroy_node()

    def _change(self, values: dict[str, Any]) -> None:
        self._settings = dataclasses.replace(self._settings, **values)

    def _on_pattern(self, message: Image) -> None:
        try:
            self._pattern = pattern_from_image(image_from_message(message))
        except (ImageError, PatternError) as error:
            # What is projected now is not known, so that the pattern before must not be used.
            self._pattern, self._pattern_trouble = None, str(error)
            self.get_logger().error(f'pattern refused: {error}')
            return
        period, stripe = self._pattern.period_px, self._pattern.stripe_center_px
        self._diagnostics.note('period (px)', f'{period:g}')
        self._diagnostics.note('stripe centre (px)', f'{stripe:g}')
        self.get_logger().info(f'pattern with period {period:g} px, stripe at {stripe:g} px')
        # The tables are made now, so that the first image does not wait for them.
        with contextlib.suppress(RefusedFrameError, PatternError):
            self._reconstructor()

    def _on_info(self, message: CameraInfo) -> None:
        values = (message.width, message.height, tuple(message.k), tuple(message.d))
        if self._rig is None or values == self._checked:
            return
        self._checked = values
        try:
            lens = lens_from_message(message)
            self._calibration_trouble = ''
            if lens is not None:
                _compare(lens, self._rig.camera, self._tolerance_px)
        except RigError as error:
            self._calibration_trouble = str(error)

    def _on_image(self, message: Image) -> None:
        self._diagnostics.count('images')
        if self._points.get_subscription_count() == 0:
            return
        if self._worker.put(message):
            self._diagnostics.count('dropped')

    def _work(self, message: Image) -> None:
        """Reconstruct one image, in the worker's thread; nothing that it holds ends the node."""
        try:
            self._reconstruct(message)
        except RefusedFrameError as refusal:
            self._diagnostics.refuse(refusal.reason, str(refusal))
        except ImageError as error:
            self._diagnostics.refuse('wrong image', str(error))
        except PatternError as error:
            self._diagnostics.refuse('wrong pattern', str(error))
        except InputError as error:
            self._diagnostics.refuse('wrong input', str(error))
        except Exception as error:
            self._diagnostics.fail(
                f'an image could not be reconstructed, by a defect of the software '
                f'({type(error).__name__}: {error}): report it with the log'
            )
            self.get_logger().debug(traceback.format_exc())

    def _reconstruct(self, message: Image) -> None:
        reconstructor = self._reconstructor()
        started_ns = self._now_ns()
        measurement = reconstructor.measure(image_from_message(message))
        cloud = measurement.cloud
        stamp_ns = stamp_to_ns(message.header.stamp)
        self._points.publish(cloud_to_message(cloud, stamp_ns, message.header.frame_id))
        self._diagnostics.count('clouds')
        self._diagnostics.measure('computation', (self._now_ns() - started_ns) / 1e9)
        latency = (self._now_ns() - stamp_ns) / 1e9
        if 0 <= latency < _LONGEST_LATENCY:
            self._diagnostics.measure('latency', latency)
        self._diagnostics.note('valid points', f'{100 * cloud.valid.mean():.1f} %')
        quality = measurement.quality
        if quality is not None:
            self._diagnostics.note('lit but not tied', f'{100 * quality.untied:.1f} %')
        self._diagnostics.note('remarks', '; '.join(quality.remarks) if quality else '')

    def _reconstructor(self) -> Reconstructor:
        """Reconstructor for the pattern and the settings of the moment; made when they change."""
        pattern, settings = self._pattern, self._settings
        if self._rig is None:
            raise NoCalibrationError('no rig is set: set the parameter rig to its rig.yaml')
        if self._calibration_trouble:
            raise WrongCalibrationError(self._calibration_trouble)
        if pattern is None:
            raise NoPatternError(self._pattern_trouble)
        if self._prepared is None or self._prepared[:2] != (pattern, settings):
            self._prepared = pattern, settings, Reconstructor(self._rig, pattern, settings)
        return self._prepared[2]

    def _judge(self) -> tuple[bytes, str]:
        if self._rig is None:
            return WARN, 'no calibration: set the parameter rig to its rig.yaml'
        if self._pattern is None:
            return WARN, f'no pattern: {self._pattern_trouble}'
        if self._calibration_trouble:
            return WARN, f'wrong calibration: {self._calibration_trouble}'
        if self._points.get_subscription_count() == 0:
            return OK, 'idle: nobody subscribes to points'
        if not self._diagnostics.recent('images'):
            return OK, 'waiting for images'
        return OK, 'working'

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def _declare_settings(parameters: Parameters) -> Settings:
    """Settings of the reconstruction from parameters of the same names."""
    default = Settings()
    return Settings(
        method=parameters.declare(
            'method',
            default.method,
            'How the phase is computed.',
            choices=tuple(METHODS),
            changeable=True,
        ),
        unwrapping=parameters.declare(
            'unwrapping',
            default.unwrapping,
            'How the phase is unwrapped.',
            choices=tuple(UNWRAPPINGS),
            changeable=True,
        ),
        tau=parameters.declare(
            'tau',
            float(default.tau),
            "Gain of Estrada's unwrapping.",
            minimum=0.0,
            maximum=1.0,
            changeable=True,
        ),
        stride=parameters.declare(
            'stride',
            default.stride,
            'Every how many pixels the cloud has a point, along rows and columns.',
            minimum=1,
            maximum=16,
            changeable=True,
        ),
        fast=parameters.declare(
            'fast',
            default.fast,
            'Whether least squares correct their model once instead of twice.',
            changeable=True,
        ),
    )


def _compare(given: Lens, camera: Lens, tolerance_px: float) -> None:
    """Raise `RigError` where camera_info's lens is another than the rig's."""
    if (given.width, given.height) != (camera.width, camera.height):
        raise RigError(
            f'camera_info says {given.width}x{given.height} pixels, the rig '
            f'{camera.width}x{camera.height}: use the rig of this camera'
        )
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 9), np.linspace(0, camera.height - 1, 9))
    pixels = np.stack([u, v], axis=-1)
    with np.errstate(all='ignore'):
        shift = np.abs(given.project(camera.rays(pixels)) - pixels).max()
    if not shift <= tolerance_px:
        raise RigError(
            f"camera_info differs from the rig's camera by up to {shift:.1f} pixels "
            f'(camera_info_tolerance is {tolerance_px:g}): use the rig of this camera'
        )


def main() -> int:
    """Run the node as a process."""
    return run(Reconstruction, 'reconstruction')


if __name__ == '__main__':
    sys.exit(main())
