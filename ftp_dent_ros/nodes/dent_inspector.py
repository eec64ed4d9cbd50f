"""Point clouds in, dents out.

Inspects the clouds of ``points`` in the camera's frame, each by itself, or each with the camera's
pose on ``tagged/camera_pose``; then its dents are moved to the map, and a dent that is seen again
is one dent of the list. While somebody publishes ``survey/pose``, that is taken for the camera's
pose, and the list is corrected where ``survey/path`` corrects the poses of earlier clouds. The
dents of each cloud go to ``dents``, the list to ``dents/list`` and ``dents/markers``, both
latched. The service ``~/take_list`` returns the list as JSON, once all clouds that came before are
in it, and clears it. Nothing is computed while nobody subscribes, unless the parameter `always`
asks for the list.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from nav_msgs.msg import Path
from numpy.typing import NDArray
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from ftp_dent_ros.cloud.cloud import check_resolution
from ftp_dent_ros.dents.dent import MeasuredDent, SmallestDent
from ftp_dent_ros.dents.dent_list import EXACT, DentList
from ftp_dent_ros.dents.glass import sentence
from ftp_dent_ros.dents.kept_list import KeptList
from ftp_dent_ros.dents.rules import Rules
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.records import list_record
from ftp_dent_ros.nodes.matching import Matched, MessageMatcher
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import TAGGED, DentInspectorSettings
from ftp_dent_ros.pages.words import finite
from ftp_dent_ros.pose import IDENTITY, Pose
from ftp_dent_ros.ros.dent_messages import dents_to_markers, dents_to_message
from ftp_dent_ros.ros.diagnostics import OK, WARN, Verdict
from ftp_dent_ros.ros.messages import cloud_from_message, pose_from_message, stamp_to_ns
from ftp_dent_ros.ros.qos import LATCHED, POSES

# Clouds that may wait to be inspected, each of some megabytes: one whose surveyed pose was lost
# comes together with the next.
_WAITING = 2
# Seconds that a request for the list waits for the clouds before it.
_PATIENCE = 60.0


class DentInspector(PayloadNode[DentInspectorSettings]):
    """Node that turns clouds into dents, and keeps the list of a flight's."""

    threads = 2

    def _set_up(self) -> None:
        given = self.given
        self._tagged = given.source == TAGGED
        self._smallest = SmallestDent(given.smallest_depth, given.smallest_width)
        self._dents = self.create_publisher(PointCloud2, 'dents', POSES)
        self._listing = DentListing(self, given.list_file, self._tagged)
        # In the end all clouds that came are put into the list first.
        self._worker = self.worker(
            self._inspect, 'a cloud could not be inspected', finish=True, room=_WAITING
        )
        parts = ('cloud', 'pose', 'surveyed') if self._tagged else ('cloud',)
        MessageMatcher(self, parts, self._worker.put, lambda: self._wanted)
        if self._tagged:
            self.hear(Path, 'survey/path', self._listing.correct, LATCHED)
        # It waits: clouds come meanwhile.
        group = MutuallyExclusiveCallbackGroup()
        self.create_service(Trigger, '~/take_list', self._take_list, callback_group=group)

    @property
    def _wanted(self) -> bool:
        listens = self._dents.get_subscription_count() or self._listing.subscribers
        return self.given.always or bool(listens)

    def _inspect(self, item: Matched) -> None:
        """Publish a cloud's dents, once they are in the list."""
        stamp_ns, frame_id = item.stamp_ns, item.cloud.header.frame_id
        pose, covariance = IDENTITY, EXACT
        with self.diagnostics.timed('inspected', stamp_ns):
            if self._tagged:
                frame_id = self.given.map_frame
                pose, covariance = item.located(frame_id)
            cloud = check_resolution(cloud_from_message(item.cloud))
            found = inspect(cloud, settings=self._smallest)
            dents = [dent.transformed(pose) for dent in (*found.dents, *found.others)]
            alone = DentList()
            alone.add(1, dents, pose, covariance)
            self._listing.add(frame_id, stamp_ns, dents, pose, covariance)
            self._dents.publish(dents_to_message(alone.entries, stamp_ns, frame_id))
        if item.surveyed is not None:
            self.diagnostics.count('placed by the survey')
        self.diagnostics.note({'dents': len(found.dents), 'others': len(found.others)})
        known = found.findable[np.isfinite(found.findable)]
        if len(known):
            findable = f'{1e3 * np.percentile(known, 95):.2f}'
            self.diagnostics.note({'findable on 95 % of the area from (mm)': findable})

    def _take_list(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._worker.settle(_PATIENCE)
        if response.success:
            record = self._listing.take(self.given.rules)
            response.message = json.dumps(finite(record), allow_nan=False)
        else:
            response.message = (
                f'not all clouds before this request are in the list after {_PATIENCE:.0f} s: '
                'nothing was taken; ask again'
            )
        return response

    def _judge(self) -> Sequence[Verdict]:
        self.diagnostics.note({'clouds waiting': len(self._worker)})
        on_glass = self._listing.on_glass
        return (
            (not self._wanted, OK, 'idle: nobody subscribes to dents'),
            (not self.diagnostics.recent('clouds'), OK, 'waiting for clouds'),
            (on_glass, WARN, on_glass),
        )


class DentListing:
    """A node's list, on ``dents/list`` and ``dents/markers``.

    It is corrected and drawn in a thread of its own that mostly rests, however long the list.

    Parameters
    ----------
    node : PayloadNode
    path : str
        File that keeps the list; empty for none.
    lasting : bool
        Whether one list is made of all clouds, or one of each.
    """

    def __init__(self, node: PayloadNode[Any], path: str, lasting: bool) -> None:
        self._diagnostics = node.diagnostics
        self._kept, self._lasting = KeptList(path), lasting
        self._lock = threading.Lock()
        self._path: Path | None = None
        self._poses: dict[int, Pose] = {}
        #: A sentence on marks on a glass; empty if there is none.
        self.on_glass = ''
        self._list = node.create_publisher(PointCloud2, 'dents/list', LATCHED)
        self._markers = node.create_publisher(MarkerArray, 'dents/markers', LATCHED)
        self._drawing = node.worker(
            self._draw, 'the list could not be drawn', finish=True, rest=1.0
        )
        if self._kept.clouds:
            self._drawing.put(self._kept)

    @property
    def subscribers(self) -> int:
        """How many listen to the list or its markers."""
        return self._list.get_subscription_count() + self._markers.get_subscription_count()

    def add(
        self,
        frame_id: str,
        stamp_ns: int,
        dents: Sequence[MeasuredDent],
        pose: Pose,
        covariance: NDArray[Any],
    ) -> None:
        """Add what a cloud shows, as `KeptList.add`."""
        with self._lock:
            if not self._lasting:
                # Places in another cloud's frame are not comparable.
                self._kept.clear()
            with self._kept_on_disk():
                self._kept.add(frame_id, stamp_ns, dents, pose, covariance)
            # Meanwhile it may have been found to lie elsewhere.
            if stamp_ns in self._poses:
                with self._kept_on_disk():
                    self._kept.correct(frame_id, {stamp_ns: self._poses[stamp_ns]})
        self._drawing.put(self._kept)

    def correct(self, path: Path) -> None:
        """Put the list where the newest path has the cameras."""
        self._path = path
        self._drawing.put(self._kept)

    def take(self, rules: Rules | None) -> dict[str, Any]:
        """The list as JSON has it, judged by rules, which is empty then."""
        with self._lock:
            self._follow()
            record = {
                **list_record(self._kept.entries, rules),
                'frame_id': self._kept.frame_id,
                'clouds': self._kept.clouds,
                'stamp_ns': self._kept.stamp_ns,
            }
            with self._kept_on_disk():
                self._kept.clear()
        self._drawing.put(self._kept)
        return record

    def _follow(self) -> None:
        """Correct the list with the newest path, if it has not been yet."""
        path, self._path = self._path, None
        if path is None:
            return
        with self._diagnostics.guarded('the list could not be corrected'):
            poses = {
                stamp_to_ns(each.header.stamp): pose_from_message(each.pose) for each in path.poses
            }
            with self._kept_on_disk():
                if self._kept.correct(path.header.frame_id, poses):
                    self._diagnostics.count('corrections of the list')
            self._poses = poses

    @contextmanager
    def _kept_on_disk(self) -> Iterator[None]:
        """Change the list, which goes on in memory if it cannot be kept on disk."""
        try:
            yield
        except OSError as error:
            self._diagnostics.fail(
                f'the list is not kept on disk ({error.strerror}): make room there'
            )

    def _draw(self, kept: KeptList) -> None:
        with self._lock:
            self._follow()
            dents, stamp_ns, frame_id = kept.snapshot(), kept.stamp_ns, kept.frame_id
        entries = dents.entries
        self._list.publish(dents_to_message(entries, stamp_ns, frame_id))
        self._markers.publish(dents_to_markers(entries, stamp_ns, frame_id))
        count = sum(entry.dent.kind == 'dent' for entry in entries)
        self.on_glass = sentence(dents.glass)
        self._diagnostics.note({'dents in the list': count, 'marks on a glass': len(dents.glass)})
