"""Clouds in, one skin out: where each cloud's camera was, by the skin that the clouds share.

Lays each cloud of ``points`` on those that it overlaps, by its shape and by the image of its
``skin``, starting from the autopilot's ``tagged/camera_pose``. ``survey/pose`` is the camera at
each cloud's stamp as it is known then; ``survey/path`` all of them as they are known now, and
``survey/coverage`` the skin that was measured, with the gaps in it: these are made while somebody
subscribes, once a second at most. Clouds have to come in the camera's frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from visualization_msgs.msg import MarkerArray

from ftp_dent_ros.errors import CloudError, FtpDentError, PoseError
from ftp_dent_ros.nodes.matching import Matched, MessageMatcher
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import SurveySettings
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.dent_messages import coverage_to_markers
from ftp_dent_ros.ros.diagnostics import OK, WARN, Verdict
from ftp_dent_ros.ros.messages import covariant_pose_message, make_header, pose_stamped_message
from ftp_dent_ros.ros.qos import LATCHED, POSES
from ftp_dent_ros.survey.footprint import Footprint, SeenSkin
from ftp_dent_ros.survey.joining import Joining


class Survey(PayloadNode[SurveySettings]):
    """Node that joins a flight's clouds to one skin."""

    def _set_up(self) -> None:
        given = self.given
        deviations = given.translation_uncertainty, given.rotation_uncertainty
        self._unstated = np.diag(np.square(np.repeat(deviations, 3)))
        self._begin()
        self._pose = self.create_publisher(PoseWithCovarianceStamped, 'survey/pose', POSES)
        self._path = self.create_publisher(Path, 'survey/path', LATCHED)
        self._coverage = self.create_publisher(MarkerArray, 'survey/coverage', LATCHED)
        self._drawing = self.worker(
            self._draw, 'the skin could not be drawn', finish=True, rest=1.0
        )
        self._worker = self.worker(
            self._work,
            'a cloud could not be joined and the survey begins anew',
            room=given.queue_size,
        )
        self._matching = MessageMatcher(self, ('cloud', 'skin', 'pose'), self._worker.put)

    def _begin(self) -> None:
        """Begin a skin, of which nothing is known yet."""
        self._joining = Joining()
        self._left_out: set[int] = set()

    def _work(self, item: Matched) -> None:
        """Join one cloud, in the worker's thread."""
        try:
            with self.diagnostics.timed('joined', item.stamp_ns):
                self._join(item)
        except FtpDentError:
            raise
        except Exception:
            self._begin()
            raise

    def _join(self, item: Matched) -> None:
        stamp_ns, frame = item.stamp_ns, self.given.map_frame
        joining = self._joining
        if stamp_ns in joining.numbers:
            raise PoseError(
                f'the cloud at {stamp_ns / 1e9:.3f} s is joined already', 'already seen'
            )
        stated, covariance = item.located(frame)
        if not covariance.any():
            covariance = self._unstated
        if item.skin is None and self._matching.expects('skin'):
            self.diagnostics.refuse('no skin', 'a cloud came without the image of its skin')
        cloud = item.with_skin(self.diagnostics)
        pose = joining.add(stamp_ns, cloud, stated, covariance)
        # A flight that is over shows how much of the autopilot's error is constant. Until then a
        # place in the map is as uncertain as the autopilot's.
        self._pose.publish(covariant_pose_message(pose, covariance, stamp_ns, frame))
        stamps, poses = tuple(joining.numbers), tuple(joining.graph.poses)
        self._drawing.put((stamps, poses, tuple(joining.footprints)))
        for text in joining.remarks:
            self.diagnostics.refuse('pair not used in full', text)
        joining.remarks.clear()
        self._tell_pairs()

    def _draw(
        self, state: tuple[tuple[int, ...], tuple[Pose, ...], tuple[Footprint, ...]]
    ) -> None:
        """Publish path and coverage of stamps, poses and footprints, in the drawing's thread."""
        stamps, poses, footprints = state
        frame = self.given.map_frame
        if self._path.get_subscription_count():
            self._path.publish(
                Path(
                    header=make_header(stamps[-1], frame),
                    poses=[
                        pose_stamped_message(pose, stamp_ns, frame)
                        for stamp_ns, pose in zip(stamps, poses, strict=True)
                    ],
                )
            )
        if not self._coverage.get_subscription_count():
            return
        try:
            seen = SeenSkin(footprints, poses)
        except CloudError as reason:
            self.diagnostics.refuse('no coverage', str(reason))
            return
        self.diagnostics.note({'measured (m2)': f'{seen.area:.3f}', 'gaps': len(seen.gaps)})
        self._coverage.publish(coverage_to_markers(seen, stamps[-1], frame))

    def _tell_pairs(self) -> None:
        """Tell what became of the pairs."""
        graph = self._joining.graph
        contradicting = self._joining.contradicting()
        for index in contradicting.keys() - self._left_out:
            self.diagnostics.refuse('contradicting pair', contradicting[index])
        self._left_out = set(contradicting)
        self.diagnostics.note(
            {
                'clouds in the survey': len(graph.poses),
                'clouds without skin': self._joining.without_skin,
                'pairs': len(graph.links),
                'pairs left out': len(contradicting),
                'pairs without ties': sum(link.relative.rank == 0 for link in graph.links),
            }
        )

    def _judge(self) -> Sequence[Verdict]:
        is_idle, has_skin = not self.diagnostics.recent('clouds'), self._matching.expects('skin')
        alone = 'nobody publishes skin: along it the clouds lie as the autopilot says'
        return (
            (is_idle and has_skin, OK, 'waiting for clouds'),
            (is_idle, OK, 'waiting for clouds and their skin'),
            (not has_skin, WARN, alone),
        )
