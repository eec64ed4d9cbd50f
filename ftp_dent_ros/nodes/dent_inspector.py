"""Point clouds in, dents out.

Inspects the clouds of ``points``, each by itself, or those of ``tagged/points`` with their poses
on ``tagged/pose``; then a dent that is seen again is one dent of the list, in the map. The dents
of each cloud go to ``dents``, the list to ``dents/list`` and ``dents/markers``, both latched. The
service ``~/take_list`` returns the list as JSON and clears it. Nothing is computed while nobody
subscribes, unless the parameter `always` asks for the list.
"""

from __future__ import annotations

import json
import sys
import threading
import traceback
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from ftp_dent_ros.errors import CloudError, PoseError
from ftp_dent_ros.files import find
from ftp_dent_ros.inspection.dent_list import EXACT, DentList, ListedDent
from ftp_dent_ros.inspection.inspection import inspect
from ftp_dent_ros.inspection.report.records import dent_record, finite
from ftp_dent_ros.inspection.rules import read_rules
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.ros.dent_messages import dents_to_markers, dents_to_message
from ftp_dent_ros.ros.diagnostics import OK, Diagnostics
from ftp_dent_ros.ros.messages import cloud_from_message, pose_from_message, stamp_to_ns
from ftp_dent_ros.ros.node import run
from ftp_dent_ros.ros.parameters import Parameters
from ftp_dent_ros.ros.qos import CLOUDS, DENTS, LATCHED, OVERRIDABLE, POSES
from ftp_dent_ros.ros.worker import NewestWorker

TAGGED = 'tagged'
# A longer time since the exposure is no latency: the clouds come from a recording.
_LONGEST_LATENCY = 60.0
# Clouds and poses that may wait for each other.
_WAITING = 10


@dataclass(frozen=True)
class _Cloud:
    message: PointCloud2
    pose: PoseWithCovarianceStamped | None = None


class DentInspector(Node):
    """Node that turns clouds into dents, and keeps the list of a flight's."""

    def __init__(self, **options: Any) -> None:
        super().__init__('dent_inspector', **options)
        parameters = Parameters(self)
        self._tagged = (
            parameters.declare(
                'source',
                'points',
                'Which clouds: points, each by itself, or tagged, whose dents become one list in '
                'the map.',
                choices=('points', TAGGED),
            )
            == TAGGED
        )
        self._always = parameters.declare(
            'always', False, 'Whether the list is kept while nobody subscribes.'
        )
        default = Settings()
        self._settings = Settings(
            smallest_depth=parameters.declare(
                'smallest_depth',
                default.smallest_depth,
                'Shallower dents are not reported, metres.',
                minimum=1e-6,
                maximum=0.1,
            ),
            smallest_width=parameters.declare(
                'smallest_width',
                default.smallest_width,
                'Narrower ones are rivets, scratches and gaps: not reported, metres.',
                minimum=1e-4,
                maximum=1.0,
            ),
        )
        rules = parameters.declare(
            'rules', '', 'File of limits to judge the list by, or the name of a shipped one.'
        )
        self._rules = read_rules(find(rules)) if rules else None
        self._lock = threading.Lock()
        self._list = DentList()
        self._clouds = 0
        self._frame_id = ''
        self._stamp_ns = 0
        self._waiting: dict[int, dict[str, Any]] = {}
        self._dents = self.create_publisher(PointCloud2, 'dents', DENTS)
        self._latched = self.create_publisher(PointCloud2, 'dents/list', LATCHED)
        self._markers = self.create_publisher(MarkerArray, 'dents/markers', LATCHED)
        self._diagnostics = Diagnostics(self, self._judge)
        self._worker = NewestWorker(self._work, 'dent_inspector')
        self.create_service(Trigger, '~/take_list', self._take_list)
        topic = 'tagged/points' if self._tagged else 'points'
        self.create_subscription(
            PointCloud2, topic, self._on_cloud, CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        if self._tagged:
            self.create_subscription(
                PoseWithCovarianceStamped, 'tagged/pose', self._on_pose, POSES
            )

    def destroy_node(self) -> None:
        """Finish the cloud in work first."""
        self._worker.stop()
        super().destroy_node()

    @property
    def _wanted(self) -> bool:
        publishers = (self._dents, self._latched, self._markers)
        return self._always or any(each.get_subscription_count() for each in publishers)

    def _on_cloud(self, message: PointCloud2) -> None:
        self._diagnostics.count('clouds')
        if not self._wanted:
            return
        if self._tagged:
            self._match(message, 'cloud')
        else:
            self._hand_over(_Cloud(message))

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        if self._wanted:
            self._match(message, 'pose')

    def _match(self, message: Any, part: str) -> None:
        """Hand over a cloud when its pose of the same stamp is there too."""
        stamp_ns = stamp_to_ns(message.header.stamp)
        parts = self._waiting.setdefault(stamp_ns, {})
        parts[part] = message
        if len(parts) == 2:
            del self._waiting[stamp_ns]
            self._hand_over(_Cloud(parts['cloud'], parts['pose']))
        while len(self._waiting) > _WAITING:
            lost = self._waiting.pop(next(iter(self._waiting)))
            if 'cloud' in lost:
                self._diagnostics.refuse('no pose', 'a tagged cloud came without its pose')

    def _hand_over(self, cloud: _Cloud) -> None:
        if self._worker.put(cloud):
            self._diagnostics.count('dropped')

    def _work(self, cloud: _Cloud) -> None:
        """Inspect one cloud, in the worker's thread; nothing that it holds ends the node."""
        try:
            self._inspect(cloud)
        except CloudError as error:
            self._diagnostics.refuse('wrong cloud', str(error))
        except PoseError as error:
            self._diagnostics.refuse('wrong pose', str(error))
        except Exception as error:
            self._diagnostics.fail(
                f'a cloud could not be inspected, by a defect of the software '
                f'({type(error).__name__}: {error}): report it with the log'
            )
            self.get_logger().debug(traceback.format_exc())

    def _inspect(self, item: _Cloud) -> None:
        started_ns = self._now_ns()
        header = item.message.header
        pose, covariance = None, EXACT
        viewpoint = np.zeros(3)
        if item.pose is not None:
            pose = pose_from_message(item.pose.pose.pose)
            covariance = np.array(item.pose.pose.covariance, float).reshape(6, 6)
            viewpoint = pose.translation
        cloud = cloud_from_message(item.message)
        found = inspect(cloud, settings=self._settings, viewpoint=viewpoint)
        dents = (*found.dents, *found.others)
        stamp_ns = stamp_to_ns(header.stamp)
        alone = DentList()
        alone.add(1, dents, pose, covariance)
        self._dents.publish(dents_to_message(alone.entries, stamp_ns, header.frame_id))
        with self._lock:
            if not self._tagged or header.frame_id != self._frame_id:
                # Places in another frame are not comparable.
                self._list = DentList()
                self._clouds = 0
            self._clouds += 1
            self._list.add(self._clouds, dents, pose, covariance)
            self._frame_id, self._stamp_ns = header.frame_id, stamp_ns
            listed = self._publish_list()
        self._diagnostics.count('inspected')
        self._diagnostics.note('dents', len(found.dents))
        self._diagnostics.note('dents in the list', _count(listed))
        self._diagnostics.measure('computation', (self._now_ns() - started_ns) / 1e9)
        latency = (self._now_ns() - stamp_ns) / 1e9
        if 0 <= latency < _LONGEST_LATENCY:
            self._diagnostics.measure('latency', latency)

    def _publish_list(self) -> tuple[ListedDent, ...]:
        entries = self._list.entries
        self._latched.publish(dents_to_message(entries, self._stamp_ns, self._frame_id))
        self._markers.publish(dents_to_markers(entries, self._stamp_ns, self._frame_id))
        return entries

    def _take_list(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._lock:
            entries = self._list.entries
            record = {
                'dents': self._records(entries),
                'others': [dent_record(e) for e in entries if e.dent.kind != 'dent'],
                'frame_id': self._frame_id,
                'clouds': self._clouds,
                'stamp_ns': self._stamp_ns,
            }
            self._list.clear()
            self._clouds = 0
            self._publish_list()
        self._diagnostics.note('dents in the list', 0)
        response.success = True
        response.message = json.dumps(finite(record), allow_nan=False)
        return response

    def _records(self, entries: tuple[ListedDent, ...]) -> list[dict[str, Any]]:
        dents = [entry for entry in entries if entry.dent.kind == 'dent']
        if self._rules is None:
            return [dent_record(entry) for entry in dents]
        judged = self._rules.judge([entry.dent for entry in dents])
        return [dent_record(e, found) for e, found in zip(dents, judged, strict=True)]

    def _judge(self) -> tuple[bytes, str]:
        if not self._wanted:
            return OK, 'idle: nobody subscribes to dents'
        if not self._diagnostics.recent('clouds'):
            return OK, 'waiting for clouds'
        return OK, 'working'

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def _count(entries: tuple[ListedDent, ...]) -> int:
    return sum(entry.dent.kind == 'dent' for entry in entries)


def main() -> int:
    """Run the node as a process."""
    return run(DentInspector, 'dent_inspector')


if __name__ == '__main__':
    sys.exit(main())
