"""Photographs in, point clouds out.

Period and stripe are read out of ``projector/image_raw``; the calibration is the parameter
``rig``. A photograph goes with the pattern that was shown when it was taken, by their stamps; one
from around a change is refused. Nothing is computed while nobody subscribes to ``points``; of the
images that arrive while one is worked on only the newest is kept. A photograph that gives no cloud
is refused with its reason, in the log and on ``/diagnostics``.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from ftp_dent_ros.cloud.coverage import NOTED_STAMP, Coverage
from ftp_dent_ros.errors import (
    NoCalibrationError,
    NoFringesError,
    PatternChangeError,
    PatternError,
    StampError,
    WrongCalibrationError,
)
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.rig_watch import RigWatch
from ftp_dent_ros.nodes.settings import ReconstructionSettings
from ftp_dent_ros.pattern.drawn import pattern_from_image
from ftp_dent_ros.pattern.history import PatternHistory
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.ros.diagnostics import OK, WARN, Verdict
from ftp_dent_ros.ros.messages import (
    cloud_to_message,
    image_from_message,
    image_to_message,
    photograph_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import CLOUDS, OVERRIDABLE, PATTERNS, AnySubscription


class Reconstruction(PayloadNode[ReconstructionSettings]):
    """Node that turns each photograph into an organised cloud of the same stamp and frame."""

    def _set_up(self) -> None:
        given = self.given
        self._patterns = PatternHistory(round(1e9 * given.pattern_settling))
        # With their tables: of the patterns before and after a change.
        self._prepared = lru_cache(maxsize=2)(Reconstructor)
        self._points = self.create_publisher(
            PointCloud2, 'points', CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        self._skin = self.create_publisher(
            Image, 'skin', CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        self._watch = RigWatch(self)
        self._covered: deque[tuple[int, Coverage]] = deque(maxlen=100)  # of a second
        self._worker = self.worker(self._reconstruct, 'an image could not be reconstructed')
        # No image at all tells nothing of what is projected.
        self.hear(Image, 'projector/image_raw', self._on_pattern, PATTERNS, 'wrong pattern')
        AnySubscription(
            self, CameraInfo, 'camera/camera_info', lambda info, _: self._watch.on_info(info)
        )
        self._images = AnySubscription(self, Image, 'camera/image_raw', self._on_image)
        self._last_stamp_ns = 0

    def _on_pattern(self, message: Image) -> None:
        """Learn what is projected from a time on."""
        image, stamp_ns = image_from_message(message), stamp_to_ns(message.header.stamp)
        try:
            pattern = pattern_from_image(image)
            if stamp_ns == 0:
                raise PatternError(
                    'the pattern image has no stamp: publish it with the time from which on it '
                    'is shown'
                )
        except PatternError as error:
            # What is projected now is not known, so that the pattern before must not be used.
            self._patterns.forget(str(error))
            self.get_logger().warning(f'no photograph is reconstructed for now: {error}')
            return
        self._patterns.add(stamp_ns, pattern)
        self._watch.pattern_changed()
        period, stripe = f'{pattern.period_px:g}', f'{pattern.stripe_center_px:g}'
        self.diagnostics.note(
            {'period (px)': period, 'stripe centre (px)': stripe, 'code': pattern.code}
        )
        self.get_logger().info(
            f'pattern with period {period} px, {pattern.code} code, centre at {stripe} px'
        )
        rig = self.given.rig
        if rig is not None:
            # The tables are made now, so that the first image does not wait for them.
            with contextlib.suppress(PatternError):
                self._reconstructor(rig, pattern)

    def _on_image(self, message: Image, _: Any) -> None:
        self.diagnostics.count('images')
        if self._points.get_subscription_count():
            self._worker.put(message)

    def _reconstruct(self, message: Image) -> None:
        """Reconstruct one image, in the worker's thread."""
        stamp_ns, frame_id = stamp_to_ns(message.header.stamp), message.header.frame_id
        with self.diagnostics.timed('clouds', stamp_ns):
            self._check_stamp(stamp_ns)
            rig = self.given.rig
            if rig is None:
                raise NoCalibrationError('no rig is set: set the parameter rig to its rig.yaml')
            pattern = self._pattern_at(stamp_ns)
            photograph = photograph_from_message(message, self.given.bits)
            measurement = self._reconstructor(rig, pattern).measure(
                photograph, self._skin.get_subscription_count() > 0
            )
            cloud = measurement.cloud
            if not cloud.valid.any():
                reasons = '; '.join(measurement.coverage.remarks)
                raise NoFringesError(f'the photograph gives no point: {reasons}')
            # The message of a change may have come meanwhile, later than the photograph.
            if self._pattern_at(stamp_ns) != pattern:
                raise PatternChangeError(
                    'the pattern that was shown came to be known only after the photograph had '
                    'been reconstructed: take photographs later after a change'
                )
            # First, so that who has the cloud has its skin.
            if cloud.skin.any():
                self._skin.publish(image_to_message(cloud.skin, stamp_ns, frame_id))
            self._points.publish(cloud_to_message(cloud, stamp_ns, frame_id))
        self._last_stamp_ns = stamp_ns
        self.diagnostics.note({'valid points': f'{100 * cloud.valid.mean():.1f} %'})
        self._watch.look(pattern, photograph, measurement)
        self._covered.append((stamp_ns, measurement.coverage))

    def _check_stamp(self, stamp_ns: int) -> None:
        """Refuse what belongs to no pose and no pattern that could be known."""
        ahead = (stamp_ns - self.now_ns()) / 1e9
        # Clocks of two computers that are kept alike differ by less.
        if ahead > 1.0:
            raise StampError(
                f'the photograph is stamped {ahead:.1f} s in the future: stamp it with the middle '
                'of its exposure, and set the clocks of the computers alike'
            )
        if stamp_ns and stamp_ns == self._last_stamp_ns:
            raise StampError(
                'the photograph has the stamp of the one before: stamp each with the middle of '
                'its exposure'
            )

    def _pattern_at(self, stamp_ns: int) -> Pattern:
        """Pattern that a photograph of the time shows; raises the refusal if it is not known."""
        if self._watch.wrong_calibration:
            raise WrongCalibrationError(self._watch.wrong_calibration)
        return self._patterns.at(stamp_ns)

    def _reconstructor(self, rig: Rig, pattern: Pattern) -> Reconstructor:
        """Reconstructor for a pattern and the settings of the moment; made when they change."""
        # Options of the other methods wait until one of them is chosen.
        chosen = Settings.chosen(**{name: self.settings[name] for name in self.given.choices})
        return self._prepared(rig, pattern, chosen)

    def _note_coverage(self) -> None:
        """Show what of the lit area has points, of the worst cloud since the last second."""
        clouds = [self._covered.popleft() for _ in range(len(self._covered))]
        if clouds:
            stamp_ns, worst = min(clouds, key=lambda each: each[1].share)
            # If the pattern of one of them could not be checked, the note says so.
            shown = replace(worst, confirmed=all(coverage.confirmed for _, coverage in clouds))
            self.diagnostics.note({**shown.notes, NOTED_STAMP: stamp_ns})

    def _judge(self) -> Sequence[Verdict]:
        self._note_coverage()
        watch, lost = self._watch, self._images.lost
        publishers = self.count_publishers('camera/image_raw')
        self.diagnostics.note({'images lost on the way': lost})
        unreliable = (
            f'camera/image_raw is published with best effort, {lost} images were lost on the way: '
            'publish it reliably'
        )
        mixed = (
            f'camera/image_raw has {publishers} publishers, whose messages mix: end all but one '
            '(one that was killed counts for 5 s)'
        )
        return (
            (
                self.given.rig is None,
                WARN,
                'no calibration: set the parameter rig to its rig.yaml',
            ),
            (self._patterns.latest is None, WARN, f'no pattern: {self._patterns.trouble}'),
            (watch.wrong_calibration, WARN, f'wrong calibration: {watch.wrong_calibration}'),
            (watch.trouble, WARN, watch.trouble),
            (self._images.is_best_effort, WARN, unreliable),
            (publishers > 1, WARN, mixed),
            (not self._points.get_subscription_count(), OK, 'idle: nobody subscribes to points'),
            (not self.diagnostics.recent('images'), OK, 'waiting for images'),
        )
