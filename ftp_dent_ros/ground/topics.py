"""Which of the payload's topics reach the ground, how important each is, and how it goes."""

from __future__ import annotations

from dataclasses import dataclass

from ftp_dent_ros.ground.protocol import Importance

_POINTS = 'sensor_msgs/msg/PointCloud2'
_POSE = 'geometry_msgs/msg/PoseWithCovarianceStamped'

POINTS, TAGGED_POINTS = 'points', 'tagged/points'
CAMERA_POSE = 'tagged/camera_pose'
IMAGE, CAMERA_INFO = 'camera/image_raw', 'camera/camera_info'
PREVIEW_POINTS, PREVIEW_IMAGE = 'preview/points', 'preview/image/compressed'
# For tools that know depth images but not these clouds.
DEPTH = 'depth/image_raw/compressedDepth'
SURVEY_PATH, SURVEY_COVERAGE = 'survey/path', 'survey/coverage'
DIAGNOSTICS = '/diagnostics'


@dataclass(frozen=True)
class Topic:
    """A topic that goes as it is: its serialised messages, deflated.

    Attributes
    ----------
    name, type : str
    importance : Importance
    latest : bool
        Latched: only the newest message counts.
    period : float
        Seconds between two that are sent; what comes in between is not.
    stamped : bool
        Whether the message begins with a header.
    share : float
        Of the link's rate, what these take up at most: one that comes too early waits, and gives
        way to the next; 0 for no bound.
    """

    name: str
    type: str
    importance: Importance
    latest: bool = False
    period: float = 0.0
    stamped: bool = True
    share: float = 0.0


AS_THEY_ARE = {
    topic.name: topic
    for topic in (
        Topic('dents/list', _POINTS, Importance.DENTS, latest=True),
        Topic(
            'dents/markers',
            'visualization_msgs/msg/MarkerArray',
            Importance.PREVIEWS,  # a drawing of the list, several times its size
            latest=True,
            stamped=False,
            share=0.1,
        ),
        # Of one cloud, as its poses are; the list has them all.
        Topic('dents', _POINTS, Importance.POSES),
        Topic('earth', 'sensor_msgs/msg/NavSatFix', Importance.POSES, latest=True),
        Topic('tagged/pose', _POSE, Importance.POSES),
        Topic(CAMERA_POSE, _POSE, Importance.POSES),
        Topic('survey/pose', _POSE, Importance.POSES),
        # Both hold the whole flight, again and again.
        Topic(SURVEY_PATH, 'nav_msgs/msg/Path', Importance.PREVIEWS, latest=True, share=0.1),
        Topic(
            SURVEY_COVERAGE,
            'visualization_msgs/msg/MarkerArray',
            Importance.PREVIEWS,
            latest=True,
            stamped=False,
            share=0.1,
        ),
        # Fifty a second fly the drone; five show where it is.
        Topic('mavlink/pose', 'geometry_msgs/msg/PoseStamped', Importance.PREVIEWS, period=0.2),
    )
}
