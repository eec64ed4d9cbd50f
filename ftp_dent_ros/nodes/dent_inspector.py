"""Point clouds in, dents out.

Inspects the clouds of ``points`` in the camera's frame with the image of their ``skin``, each by
itself, or each with the camera's pose on ``tagged/camera_pose``; then its dents are moved to the
map, and a dent that is seen again is one dent of the list. While somebody publishes
``survey/pose``, that is taken for the camera's pose, and the list is corrected where
``survey/path`` corrects the poses of earlier clouds. The dents of each cloud go to ``dents``, the
list to ``dents/list`` and ``dents/markers``, both latched. The service ``~/take_list`` returns the
list as JSON and clears it. Nothing is computed while nobody subscribes, unless the parameter
`always` asks for the list.
"""

from __future__ import annotations

import json
import sys
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import Trigger

from ftp_dent_ros.dents.dent import Inspection
from ftp_dent_ros.dents.dent_list import EXACT, DentList
from ftp_dent_ros.dents.kept_list import KeptList
from ftp_dent_ros.errors import CloudError, ImageError, PoseError
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.nodes.declarations import names_of_all
from ftp_dent_ros.nodes.dent_listing import DentListing, Shown
from ftp_dent_ros.nodes.inspector_parameters import declare
from ftp_dent_ros.nodes.matching import Matched, MessageMatcher, located
from ftp_dent_ros.pages.words import finite
from ftp_dent_ros.pose import IDENTITY
from ftp_dent_ros.ros.dent_messages import dents_to_message
from ftp_dent_ros.ros.diagnostics import OK, WARN, Diagnostics
from ftp_dent_ros.ros.messages import cloud_from_message, image_from_message, stamp_to_ns
from ftp_dent_ros.ros.node import NewestWorker, run
from ftp_dent_ros.ros.parameters import Parameters
from ftp_dent_ros.ros.qos import CLOUDS, DENTS, LATCHED, OVERRIDABLE, POSES

# Clouds that may wait: one whose surveyed pose was lost comes together with the next.
_WAITING = 2


class DentInspector(Node):
    """Node that turns clouds into dents, and keeps the list of a flight's."""

    def __init__(self, **options: Any) -> None:
        super().__init__('dent_inspector', **options)
        parameters = Parameters(self)
        given = declare(parameters)
        parameters.close(names_of_all)
        self._map = given.map_frame
        self._tagged, self._always = given.is_tagged, given.always
        self._settings = given.settings
        self._rules = given.rules
        kept = KeptList(given.list_file if self._tagged else None)
        self._dents = self.create_publisher(PointCloud2, 'dents', DENTS)
        self._diagnostics = Diagnostics(self, self._judge)
        self._listing = DentListing(self, self._diagnostics, kept, self._tagged)
        self._matching = MessageMatcher(
            self._hand_over,
            self._diagnostics.refuse,
            self._expected,
            posed=self._tagged,
        )
        self._worker = NewestWorker(self._work, 'dent_inspector', _WAITING)
        self.create_service(Trigger, '~/take_list', self._take_list)
        self.create_subscription(
            PointCloud2, 'points', self._on_cloud, CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        self.create_subscription(
            Image, 'skin', self._on_skin, CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        if self._tagged:
            self.create_subscription(
                PoseWithCovarianceStamped, 'tagged/camera_pose', self._on_pose, POSES
            )
            self.create_subscription(
                PoseWithCovarianceStamped, 'survey/pose', self._on_surveyed, POSES
            )
            self.create_subscription(Path, 'survey/path', self._listing.correct, LATCHED)

    def destroy_node(self) -> None:
        """Finish the cloud in work first."""
        self._worker.stop()
        self._listing.close()
        super().destroy_node()

    @property
    def _wanted(self) -> bool:
        listens = self._dents.get_subscription_count() or self._listing.subscribers
        return self._always or bool(listens)

    def _on_cloud(self, message: PointCloud2) -> None:
        self._diagnostics.count('clouds')
        if self._wanted:
            self._matching.add(cloud=message)

    def _on_skin(self, message: Image) -> None:
        if self._wanted:
            self._matching.add(skin=message)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        if self._wanted:
            self._matching.add(pose=message)

    def _on_surveyed(self, message: PoseWithCovarianceStamped) -> None:
        if self._wanted:
            self._matching.add(surveyed=message)

    def _expected(self) -> list[str]:
        topics = {'skin': 'skin', 'surveyed': 'survey/pose' if self._tagged else ''}
        return [part for part, topic in topics.items() if topic and self.count_publishers(topic)]

    def _hand_over(self, cloud: Matched) -> None:
        if self._worker.put(cloud):
            self._diagnostics.drop()

    def _work(self, cloud: Matched) -> None:
        """Inspect one cloud, in the worker's thread; nothing that it holds ends the node."""
        try:
            self._inspect(cloud)
        except CloudError as error:
            self._diagnostics.refuse('wrong cloud', str(error))
        except PoseError as error:
            self._diagnostics.refuse(error.reason, str(error))
        except Exception as error:
            self._diagnostics.fail_by_defect('a cloud could not be inspected', error)

    def _inspect(self, item: Matched) -> None:
        started_ns = self._now_ns()
        header = item.cloud.header
        stamp_ns = stamp_to_ns(header.stamp)
        pose, covariance, frame_id = IDENTITY, EXACT, header.frame_id
        stated = item.best_pose
        if stated is not None:
            pose, covariance = located(stated, header.frame_id, self._map)
            frame_id = stated.header.frame_id
        if item.surveyed is not None:
            self._diagnostics.count('placed by the survey')
        cloud = cloud_from_message(item.cloud).with_skin(self._skin_of(item))
        found = inspect(cloud, settings=self._settings)
        dents = [dent.transformed(pose) for dent in (*found.dents, *found.others)]
        alone = DentList()
        alone.add(1, dents, pose, covariance)
        message = dents_to_message(alone.entries, stamp_ns, frame_id)
        shown = Shown(frame_id, stamp_ns, dents, pose, covariance)
        self._listing.add(shown, partial(self._tell, found, message))
        self._diagnostics.measure('computation', (self._now_ns() - started_ns) / 1e9)

    def _skin_of(self, item: Matched) -> NDArray[np.uint8] | None:
        if item.skin is None:
            return None
        try:
            return image_from_message(item.skin)[..., 0]
        except ImageError as error:
            self._diagnostics.refuse('wrong skin', str(error))
            return None

    def _tell(self, found: Inspection, dents: PointCloud2) -> None:
        """Publish and tell what a cloud shows, whose dents are in the list."""
        self._dents.publish(dents)
        self._diagnostics.count('inspected')
        self._diagnostics.note('dents', len(found.dents))
        self._diagnostics.note('others', len(found.others))
        findable = found.findable[np.isfinite(found.findable)]
        if len(findable):
            depth = f'{1e3 * np.percentile(findable, 95):.2f}'
            self._diagnostics.note('findable on 95 % of the area from (mm)', depth)
        self._diagnostics.measure_latency(stamp_to_ns(dents.header.stamp))

    def _take_list(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        record = self._listing.take(self._rules)
        response.success = True
        response.message = json.dumps(finite(record), allow_nan=False)
        return response

    def _judge(self) -> tuple[bytes, str]:
        if not self._wanted:
            return OK, 'idle: nobody subscribes to dents'
        if not self._diagnostics.recent('clouds'):
            return OK, 'waiting for clouds'
        on_glass = self._listing.on_glass
        return (WARN, on_glass) if on_glass else (OK, 'working')

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def main() -> int:
    """Run the node as a process."""
    return run(DentInspector, 'dent_inspector')


if __name__ == '__main__':
    sys.exit(main())
