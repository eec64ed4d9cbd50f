"""Which of the payload's topics reach the ground, how important each is, and how it goes."""

from __future__ import annotations

from dataclasses import dataclass

from ftp_dent_ros.ground.protocol import Importance, Item
from ftp_dent_ros.rig.rig import Lens

_POINTS = 'sensor_msgs/msg/PointCloud2'
_POSE = 'geometry_msgs/msg/PoseWithCovarianceStamped'
_COMPRESSED = 'sensor_msgs/msg/CompressedImage'
_MARKERS = 'visualization_msgs/msg/MarkerArray'

POINTS, TAGGED_POINTS = 'points', 'tagged/points'
CAMERA_POSE = 'tagged/camera_pose'
IMAGE, CAMERA_INFO = 'camera/image_raw', 'camera/camera_info'
PREVIEW_POINTS, PREVIEW_IMAGE = 'preview/points', 'preview/image/compressed'
SURVEY_PATH, SURVEY_COVERAGE = 'survey/path', 'survey/coverage'
DIAGNOSTICS = '/diagnostics'


@dataclass(frozen=True)
class Topic:
    """A topic that crosses the link.

    Attributes
    ----------
    name, type : str
        As it is on the ground.
    importance : Importance
    latest : bool
        Latched: only the newest message counts.
    share : float
        Of the link's rate, what these take up at most: one that comes too early waits, and gives
        way to the next; 0 for no bound.
    period : float
        Seconds between two that are sent, however fast the link is, of those with a share.
    stamped : bool
        Whether the message begins with a header.
    coded : str
        ``cloud`` or ``jpeg``, as what its items come; empty for serialised messages as they are.
    """

    name: str
    type: str
    importance: Importance
    latest: bool = False
    share: float = 0.0
    period: float = 0.0
    stamped: bool = True
    coded: str = ''

    @property
    def kind(self) -> str:
        """What its items say of their data."""
        return self.coded or f'cdr:{self.type}'

    def item(self, stamp_ns: int, data: bytes, frame: str = '', lens: Lens | None = None) -> Item:
        """An item of this topic."""
        return Item(
            self.importance, self.name, self.kind, stamp_ns, data, self.latest, frame, lens
        )


TOPICS = {
    topic.name: topic
    for topic in (
        Topic(
            DIAGNOSTICS,
            'diagnostic_msgs/msg/DiagnosticArray',
            Importance.STATE,
            share=0.25,
            period=1.0,
        ),
        Topic('dents/list', _POINTS, Importance.DENTS, latest=True),
        # A drawing of the list, several times its size.
        Topic(
            'dents/markers',
            _MARKERS,
            Importance.PREVIEWS,
            latest=True,
            share=0.1,
            stamped=False,
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
            _MARKERS,
            Importance.PREVIEWS,
            latest=True,
            share=0.1,
            stamped=False,
        ),
        # Fifty a second fly the drone; five show where it is.
        Topic(
            'mavlink/pose',
            'geometry_msgs/msg/PoseStamped',
            Importance.PREVIEWS,
            share=1.0,
            period=0.2,
        ),
        # Two a second at most.
        Topic(PREVIEW_POINTS, _POINTS, Importance.PREVIEWS, share=0.4, period=0.45, coded='cloud'),
        Topic(
            PREVIEW_IMAGE, _COMPRESSED, Importance.PREVIEWS, share=0.4, period=0.45, coded='jpeg'
        ),
        Topic(POINTS, _POINTS, Importance.CLOUDS, coded='cloud'),
        Topic(IMAGE, 'sensor_msgs/msg/Image', Importance.PICTURES, coded='jpeg'),
    )
}
#: Types of what is made on the ground of these.
MADE_ON_THE_GROUND = {TAGGED_POINTS: _POINTS, CAMERA_INFO: 'sensor_msgs/msg/CameraInfo'}
