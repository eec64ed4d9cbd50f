"""What the survey shows of the whole flight: its path, and the skin that was measured.

Both grow with the flight, and change as a whole with every cloud: they are made in a thread of
their own, of the newest state alone, and that thread rests longer than it works.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass

from nav_msgs.msg import Path
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.coverage_messages import coverage_to_markers
from ftp_dent_ros.ros.diagnostics import Diagnostics
from ftp_dent_ros.ros.messages import make_header, pose_stamped_message
from ftp_dent_ros.ros.qos import LATCHED
from ftp_dent_ros.ros.worker import NewestWorker
from ftp_dent_ros.survey.footprint import Footprint, seen_skin

# Seconds between two, and of the time spent on one, how often that is rested.
_PERIOD, _REST = 1.0, 10.0


@dataclass(frozen=True, eq=False)
class State:
    """All clouds of a survey, where their cameras are known to have been."""

    stamps_ns: Sequence[int]
    poses: Sequence[Pose]
    footprints: Sequence[Footprint]


class SurveyDrawing:
    """Publishes ``survey/path`` and ``survey/coverage`` while somebody subscribes to them.

    Parameters
    ----------
    node : rclpy.node.Node
    diagnostics : Diagnostics
        Of that node.
    frame_id : str
        Of the poses.
    """

    def __init__(self, node: Node, diagnostics: Diagnostics, frame_id: str) -> None:
        self._diagnostics, self._frame = diagnostics, frame_id
        self._path = node.create_publisher(Path, 'survey/path', LATCHED)
        self._coverage = node.create_publisher(MarkerArray, 'survey/coverage', LATCHED)
        self._ending = threading.Event()
        self._worker = NewestWorker(self._draw, 'drawing', room=1)

    def close(self) -> None:
        """End the thread."""
        self._ending.set()
        self._worker.stop()

    def show(self, state: State) -> None:
        """Show a state when it is time, unless a newer one comes before."""
        self._worker.put(state)

    def _draw(self, state: State) -> None:
        started = time.monotonic()
        try:
            if self._path.get_subscription_count():
                self._path.publish(self._path_message(state))
            if self._coverage.get_subscription_count():
                self._publish_coverage(state)
        except Exception as error:
            self._diagnostics.fail_by_defect('the skin could not be drawn', error)
        self._ending.wait(max(_PERIOD, _REST * (time.monotonic() - started)))

    def _publish_coverage(self, state: State) -> None:
        seen = seen_skin(state.footprints, state.poses)
        if seen is None:
            self._diagnostics.refuse('no coverage', 'the poses are too far apart to draw the skin')
            return
        self._diagnostics.note('measured (m2)', f'{seen.area:.3f}')
        self._diagnostics.note('gaps', len(seen.gaps))
        self._coverage.publish(coverage_to_markers(seen, state.stamps_ns[-1], self._frame))

    def _path_message(self, state: State) -> Path:
        return Path(
            header=make_header(state.stamps_ns[-1], self._frame),
            poses=[
                pose_stamped_message(pose, stamp_ns, self._frame)
                for stamp_ns, pose in zip(state.stamps_ns, state.poses, strict=True)
            ],
        )
