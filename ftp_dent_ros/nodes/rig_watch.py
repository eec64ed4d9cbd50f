"""Whether the rig still holds, by what the camera says and what photographs and clouds show."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo

from ftp_dent_ros.calibration.rig_check import CheckAside
from ftp_dent_ros.errors import CalibrationError, RigError
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import ReconstructionSettings
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.flicker import LAST as FLICKER_LAST
from ftp_dent_ros.photograph.flicker import MUCH, fall_of_light, flicker, light_of
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.checks.epipolar import EpipolarCheck
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.profilometry.rig_alarm import LAST, rig_alarm
from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.ros.messages import lens_from_message

# Seconds between checks of the rig's turn at least: each takes one of the processor, aside.
_CHECK_PERIOD = 30.0


class RigWatch:
    """Watches over a rig while it is used, and tells of it in the diagnostics and the log.

    Parameters
    ----------
    node : PayloadNode
        Without a rig there is nothing to watch.

    Attributes
    ----------
    wrong_calibration : str
        How camera_info contradicts the rig; empty if it does not.
    """

    def __init__(self, node: PayloadNode[ReconstructionSettings]) -> None:
        self._rig, self._tolerance_px = node.given.rig, node.given.camera_info_tolerance
        self._diagnostics, self._logger = node.diagnostics, node.get_logger()
        self.wrong_calibration = ''
        self._camera_info: tuple[Any, ...] = ()
        self._epipolar: deque[EpipolarCheck] = deque(maxlen=LAST)
        self._lights: deque[NDArray] = deque(maxlen=FLICKER_LAST)
        self._epipolar_trouble, self._turned = '', ''
        self._aside = CheckAside()
        self._worker = node.worker(
            self._check_turn, 'the rig could not be checked', rest=_CHECK_PERIOD
        )
        node.ending.callback(self._aside.end)
        self._diagnostics.note({'rig': self._rig.id if self._rig else 'none'})
        if self._rig is not None:
            self._diagnostics.note({'camera_info': "none came: the rig's own camera is believed"})

    @property
    def trouble(self) -> str:
        """Why the rig does not hold, by the last clouds; empty if nothing is sure."""
        return self._epipolar_trouble or self._turned

    def on_info(self, message: CameraInfo) -> None:
        """Compare the lens that the camera says with the rig's; what is no lens contradicts none.

        What is believed is the rig, so that a message that cannot be read is logged and ignored.
        """
        values = (message.width, message.height, tuple(message.k), tuple(message.d))
        if self._rig is None or values == self._camera_info:
            return
        try:
            lens = lens_from_message(message)
        except RigError as error:
            self._diagnostics.note({'camera_info': f'ignored: {error}'})
            self._diagnostics.refuse('wrong camera_info', str(error))
            return
        self._camera_info = values
        self._diagnostics.note({'camera_info': 'comes'})
        self.wrong_calibration = (
            '' if lens is None else _difference(lens, self._rig.camera, self._tolerance_px)
        )

    def pattern_changed(self) -> None:
        """Forget the clouds of another pattern: they are of this rig, but not of these rows."""
        self._epipolar.clear()

    def look(self, pattern: Pattern, photograph: Photograph, measurement: Measurement) -> None:
        """Look at another photograph and its cloud."""
        if self._rig is None:
            return
        self._note_flicker(self._rig, photograph, measurement.cloud.points)
        self._note_epipolar(measurement.epipolar)
        self._worker.put((self._rig, pattern, photograph, measurement.cloud.points))

    def _note_flicker(self, rig: Rig, photograph: Photograph, points: NDArray) -> None:
        """Say how the light changes from photograph to photograph, and what to do if it does."""
        fall = fall_of_light(points, rig.projector_centre)
        self._lights.append(light_of(photograph) / fall)
        found = flicker(self._lights)
        if found is not None:
            advice = ': expose for a whole number of projector frames, if the skin is plain'
            self._diagnostics.note({'flicker': found.text + advice * (found.worst > MUCH)})

    def _note_epipolar(self, check: EpipolarCheck | None) -> None:
        """Say how far the light lies beside its epipolar lines, and whether the rig has moved."""
        if check is None or not check.seen:
            return
        self._epipolar.append(check)
        self._diagnostics.note(
            {
                'beside epipolar lines (px)': f'{check.shift:+.3f}',
                'its uncertainty (px)': f'{check.shift_deviation:.3f}',
                'epipolar lines': check.sentence,
            }
        )
        self._epipolar_trouble = rig_alarm(self._epipolar)
        if self._epipolar_trouble:
            self._logger.error(self._epipolar_trouble, throttle_duration_sec=_CHECK_PERIOD)

    def _check_turn(self, given: tuple[Rig, Pattern, Photograph, NDArray]) -> None:
        """Whether the projector has turned, as far as a curved skin tells."""
        try:
            found = self._aside.check(*given, math.inf)
        except CalibrationError as reason:
            self._diagnostics.note({'rig check': f'not possible: {reason}'})
            return
        self._diagnostics.note({'rig check': found.sentence})
        self._turned = '' if found.holds else found.sentence


def _difference(given: Lens, camera: Lens, tolerance_px: float) -> str:
    """How camera_info's lens contradicts the rig's; empty if it does not."""
    if (given.width, given.height) != (camera.width, camera.height):
        return (
            f'camera_info says {given.width}x{given.height} pixels, the rig '
            f'{camera.width}x{camera.height}: use the rig of this camera'
        )
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 9), np.linspace(0, camera.height - 1, 9))
    pixels = np.stack([u, v], axis=-1)
    with np.errstate(all='ignore'):
        shift = np.abs(given.project(camera.rays(pixels)) - pixels).max()
    if shift <= tolerance_px:
        return ''
    return (
        f"camera_info differs from the rig's camera by up to {shift:.1f} pixels "
        f'(camera_info_tolerance is {tolerance_px:g}): use the rig of this camera'
    )
