"""The dent inspector's list: added to, corrected and published in a thread of its own.

Clouds are inspected meanwhile: none of them waits for a correction of the whole list.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from nav_msgs.msg import Path
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from ftp_dent_ros.dents.dent import MeasuredDent
from ftp_dent_ros.dents.glass import sentence
from ftp_dent_ros.dents.kept_list import KeptList
from ftp_dent_ros.dents.rules import Rules
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.errors import CloudError, PoseError
from ftp_dent_ros.inspection.records import list_record
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.dent_messages import dents_to_markers, dents_to_message
from ftp_dent_ros.ros.diagnostics import Diagnostics
from ftp_dent_ros.ros.messages import pose_from_message, stamp_to_ns
from ftp_dent_ros.ros.qos import LATCHED
from ftp_dent_ros.ros.worker import NewestWorker

# Clouds' dents that may wait while a long list is corrected: minutes of them.
_WAITING = 1000


@dataclass(frozen=True, eq=False)
class Shown:
    """What one cloud shows, and where its camera was."""

    frame_id: str
    stamp_ns: int
    dents: Sequence[MeasuredDent]
    pose: Pose
    covariance: NDArray[Any]


class DentListing:
    """Keeps the list of a node, and publishes it on ``dents/list`` and ``dents/markers``.

    Parameters
    ----------
    node : rclpy.node.Node
    diagnostics : Diagnostics
        Of that node.
    kept : KeptList
    lasting : bool
        Whether one list is made of all clouds, or one of each.
    """

    def __init__(
        self, node: Node, diagnostics: Diagnostics, kept: KeptList, lasting: bool
    ) -> None:
        self._diagnostics = diagnostics
        self._kept, self._lasting = kept, lasting
        self._lock = threading.Lock()
        self._path = Path()
        self._on_glass = ''
        self._poses: dict[int, Pose] = {}
        self._list = node.create_publisher(PointCloud2, 'dents/list', LATCHED)
        self._markers = node.create_publisher(MarkerArray, 'dents/markers', LATCHED)
        self._worker = NewestWorker[Callable[[], None]](self._work, 'dent_list', _WAITING)
        if kept.clouds:
            self._publish()

    @property
    def subscribers(self) -> int:
        """How many listen to the list or its markers."""
        return self._list.get_subscription_count() + self._markers.get_subscription_count()

    @property
    def on_glass(self) -> str:
        """What is told of marks on a glass; empty if there is none."""
        return self._on_glass

    def close(self) -> None:
        """End the thread."""
        self._worker.stop()

    def add(self, shown: Shown, done: Callable[[], None]) -> None:
        """Add what a cloud shows; `done` is called when the list with it is published."""
        if self._worker.put(partial(self._add, shown, done)):
            self._diagnostics.drop()

    def correct(self, path: Path) -> None:
        """Put the list where the newest path has the cameras."""
        self._path = path
        self._worker.put(partial(self._correct, path))

    def take(self, rules: Rules | None) -> dict[str, Any]:
        """The list as JSON has it, which is empty then."""
        with self._lock:
            record = {
                **list_record(self._kept.entries, rules),
                'frame_id': self._kept.frame_id,
                'clouds': self._kept.clouds,
                'stamp_ns': self._kept.stamp_ns,
            }
            self._kept.clear()
            self._publish()
        return record

    def _work(self, task: Callable[[], None]) -> None:
        """Do one thing, in the worker's thread; nothing that messages hold ends it."""
        try:
            task()
        except CloudError as error:
            self._diagnostics.refuse('wrong cloud', str(error))
        except PoseError as error:
            self._diagnostics.refuse(error.reason, str(error))
        except Exception as error:
            self._diagnostics.fail_by_defect('the list could not be changed', error)

    def _add(self, shown: Shown, done: Callable[[], None]) -> None:
        with self._lock:
            if not self._lasting:
                # Places in another cloud's frame are not comparable.
                self._kept.clear()
            self._keep(
                lambda: self._kept.add(
                    shown.frame_id, shown.stamp_ns, shown.dents, shown.pose, shown.covariance
                )
            )
            # Meanwhile it may have been found to lie elsewhere.
            newer = self._poses.get(shown.stamp_ns)
            if newer is not None:
                self._keep(lambda: self._kept.correct(shown.frame_id, {shown.stamp_ns: newer}))
            self._publish()
        done()

    def _correct(self, path: Path) -> None:
        if path is not self._path:
            return
        self._poses = {
            stamp_to_ns(each.header.stamp): pose_from_message(each.pose) for each in path.poses
        }
        with self._lock:
            if self._keep(lambda: self._kept.correct(path.header.frame_id, self._poses)):
                self._diagnostics.count('corrections of the list')
                self._publish()

    def _keep(self, change: Callable[[], bool | None]) -> bool:
        """Change the list; whether it has changed, or at least could not be kept on disk."""
        try:
            return bool(change())
        except OSError as error:
            self._diagnostics.fail(
                f'the list is not kept on disk ({error.strerror}): make room there'
            )
            return True

    def _publish(self) -> None:
        entries = self._kept.entries
        header = self._kept.stamp_ns, self._kept.frame_id
        self._list.publish(dents_to_message(entries, *header))
        self._markers.publish(dents_to_markers(entries, *header))
        self._diagnostics.note('dents in the list', _count(entries))
        marks = self._kept.glass
        self._on_glass = sentence(marks)
        self._diagnostics.note('marks on a glass', len(marks))


def _count(entries: tuple[ListedDent, ...]) -> int:
    return sum(entry.dent.kind == 'dent' for entry in entries)
