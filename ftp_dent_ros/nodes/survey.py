"""Clouds in, one skin out: where each cloud's camera was, by the skin that the clouds share.

Lays each cloud of ``points`` on those that it overlaps, by its shape and by the image of its
``skin``, starting from the autopilot's ``tagged/camera_pose``. ``survey/pose`` is the camera at
each cloud's stamp as it is known then; ``survey/path`` all of them as they are known now, and
``survey/coverage`` the skin that was measured, with the gaps in it: these are made while somebody
subscribes, once a second at most. Clouds have to come in the camera's frame.
"""

from __future__ import annotations

import sys
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from numpy.typing import NDArray
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from ftp_dent_ros.errors import FtpDentError, ImageError, PoseError
from ftp_dent_ros.nodes.drawing import Drawing
from ftp_dent_ros.nodes.matching import Matched, MessageMatcher, located
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import SurveySettings
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.dent_messages import coverage_to_markers
from ftp_dent_ros.ros.diagnostics import OK, WARN
from ftp_dent_ros.ros.messages import (
    cloud_from_message,
    covariant_pose_message,
    image_from_message,
    make_header,
    pose_stamped_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.node import NewestWorker, run
from ftp_dent_ros.ros.qos import CLOUDS, LATCHED, OVERRIDABLE, POSES
from ftp_dent_ros.survey.footprint import Footprint, seen_skin
from ftp_dent_ros.survey.joining import Joining

# Stamps, poses and footprints of all clouds.
State = tuple[tuple[int, ...], tuple[Pose, ...], tuple[Footprint, ...]]


class Survey(PayloadNode[SurveySettings]):
    """Node that joins a flight's clouds to one skin."""

    def __init__(self, **options: Any) -> None:
        super().__init__('survey', **options)
        given = self.given
        deviations = given.translation_uncertainty, given.rotation_uncertainty
        self._unstated = np.diag(np.square(np.repeat(deviations, 3)))
        self._begin()
        self._pose = self.create_publisher(PoseWithCovarianceStamped, 'survey/pose', POSES)
        self._path = self.create_publisher(Path, 'survey/path', LATCHED)
        self._coverage = self.create_publisher(MarkerArray, 'survey/coverage', LATCHED)
        self._drawing = Drawing(self._draw, self.diagnostics, 'the skin')
        self._worker = NewestWorker(
            self.diagnostics,
            self._work,
            'a cloud could not be joined and the survey begins anew',
            given.queue_size,
        )
        self._matching = MessageMatcher(
            self._worker.put,
            self.diagnostics.refuse,
            lambda: ('skin',) if self._has_skin else (),
        )
        self.create_subscription(
            Image,
            'skin',
            lambda message: self._matching.add(skin=message),
            CLOUDS,
            qos_overriding_options=OVERRIDABLE,
        )
        self.create_subscription(
            PointCloud2, 'points', self._on_cloud, CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        self.create_subscription(
            PoseWithCovarianceStamped,
            'tagged/camera_pose',
            lambda message: self._matching.add(pose=message),
            POSES,
        )

    def destroy_node(self) -> None:
        """Finish the cloud in work first."""
        self._worker.stop()
        self._drawing.close()
        super().destroy_node()

    def _begin(self) -> None:
        """Begin a skin, of which nothing is known yet."""
        self._joining = Joining(self._on_remark)
        self._known: set[int] = set()
        self._left_out: set[int] = set()
        self._without_ties = 0

    @property
    def _has_skin(self) -> bool:
        return self.count_publishers('skin') > 0

    def _on_cloud(self, message: PointCloud2) -> None:
        self.diagnostics.count('clouds')
        self._matching.add(cloud=message)

    def _work(self, item: Matched) -> None:
        """Join one cloud, in the worker's thread."""
        try:
            self._join(item)
        except FtpDentError:
            raise
        except Exception:
            self._begin()
            raise

    def _join(self, item: Matched) -> None:
        started_ns = self.now_ns()
        header = item.cloud.header
        stamp_ns = stamp_to_ns(header.stamp)
        if stamp_ns in self._known:
            raise PoseError(
                f'the cloud at {stamp_ns / 1e9:.3f} s is joined already', 'already seen'
            )
        stated, covariance = located(item.best_pose, header.frame_id, self.given.map_frame)
        if not covariance.any():
            covariance = self._unstated
        cloud = cloud_from_message(item.cloud)
        skin = self._skin_of(item, cloud.valid.shape)
        joining = self._joining
        links = len(joining.graph.links)
        pose = joining.add(stamp_ns, cloud, skin, stated, covariance)
        self._known.add(stamp_ns)
        now_known = joining.newest_covariance()
        self._pose.publish(covariant_pose_message(pose, now_known, stamp_ns, self.given.map_frame))
        stamps, poses = tuple(joining.stamps_ns), tuple(joining.graph.poses)
        self._drawing.show((stamps, poses, tuple(joining.footprints)))
        self._tell_pairs(links)
        self.diagnostics.count('joined')
        self.diagnostics.measure('computation', (self.now_ns() - started_ns) / 1e9)
        self.diagnostics.measure_latency(stamp_ns)

    def _draw(self, state: State) -> None:
        """Publish the path and the coverage of a state, in the drawing's thread."""
        stamps, poses, footprints = state
        if self._path.get_subscription_count():
            self._path.publish(
                Path(
                    header=make_header(stamps[-1], self.given.map_frame),
                    poses=[
                        pose_stamped_message(pose, stamp_ns, self.given.map_frame)
                        for stamp_ns, pose in zip(stamps, poses, strict=True)
                    ],
                )
            )
        if not self._coverage.get_subscription_count():
            return
        seen = seen_skin(footprints, poses)
        if seen is None:
            self.diagnostics.refuse('no coverage', 'the poses are too far apart to draw the skin')
            return
        self.diagnostics.notes({'measured (m2)': f'{seen.area:.3f}', 'gaps': len(seen.gaps)})
        self._coverage.publish(coverage_to_markers(seen, stamps[-1], self.given.map_frame))

    def _skin_of(self, item: Matched, shape: tuple[int, ...]) -> NDArray[Any] | None:
        """Image of a cloud's skin, if there is one that fits the cloud."""
        if item.skin is None:
            if self._has_skin:
                self.diagnostics.refuse('no skin', 'a cloud came without the image of its skin')
            return None
        with self.diagnostics.guarded('a skin could not be read', 'wrong skin'):
            skin = image_from_message(item.skin)[..., 0]
            if skin.shape != shape:
                raise ImageError(
                    f'the image of the skin has {skin.shape} pixels where its cloud has {shape} '
                    'points: take both from one reconstruction'
                )
            return skin
        return None

    def _tell_pairs(self, links: int) -> None:
        """Tell what became of the pairs: those that were there already, and those from `links`."""
        graph = self._joining.graph
        self._without_ties += sum(link.relative.rank == 0 for link in graph.links[links:])
        contradicting = self._joining.contradicting()
        for index in contradicting.keys() - self._left_out:
            self.diagnostics.refuse('contradicting pair', contradicting[index])
        self._left_out = set(contradicting)
        self.diagnostics.notes(
            {
                'clouds in the survey': len(graph.poses),
                'clouds without skin': self._joining.without_skin,
                'pairs': len(graph.links),
                'pairs left out': len(contradicting),
                'pairs without ties': self._without_ties,
            }
        )

    def _on_remark(self, text: str) -> None:
        self.diagnostics.refuse('pair not used in full', text)

    def _judge(self) -> tuple[bytes, str]:
        has_skin = self._has_skin
        if not self.diagnostics.recent('clouds'):
            return OK, 'waiting for clouds' if has_skin else 'waiting for clouds and their skin'
        if not has_skin:
            return WARN, 'nobody publishes skin: along it the clouds lie as the autopilot says'
        return OK, 'working'


#: Run the node as a process.
main = partial(run, Survey, 'survey')


if __name__ == '__main__':
    sys.exit(main())
