"""Measured skin and its gaps as markers."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ftp_dent_ros.ros.messages import make_header
from ftp_dent_ros.survey.footprint import SeenSkin

# Height of a letter, and gaps that have one: the largest; metres.
_TEXT, _LABELLED = 0.03, 20
_GREEN, _RED = (0.1, 0.65, 0.3, 0.45), (0.95, 0.1, 0.1, 0.9)
# Two triangles of a strip's four corners.
_TRIANGLES = [0, 1, 2, 0, 2, 3]


def coverage_to_markers(seen: SeenSkin, stamp_ns: int, frame_id: str) -> MarkerArray:
    """visualization_msgs/MarkerArray: what was measured, green, and gaps, red, with their sizes.

    Its first marker deletes all that were there before.
    """
    header = make_header(stamp_ns, frame_id)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for name, mask, colour in (
        ('measured', seen.measured, _GREEN),
        ('gaps', seen.gap_mask(), _RED),
    ):
        corners = seen.strips(mask)
        if not len(corners):
            continue
        marker = Marker(header=header, ns=name, type=Marker.TRIANGLE_LIST)
        marker.scale = Vector3(x=1.0, y=1.0, z=1.0)
        marker.pose.orientation.w = 1.0
        marker.color = _colour(colour)
        marker.points = [_point(each) for each in corners[:, _TRIANGLES].reshape(-1, 3)]
        markers.append(marker)
    for number, gap in enumerate(seen.gaps[:_LABELLED]):
        label = Marker(header=header, ns='sizes', id=number, type=Marker.TEXT_VIEW_FACING)
        label.scale = Vector3(x=0.0, y=0.0, z=_TEXT)
        label.pose.orientation.w = 1.0
        label.color = _colour(_RED)
        label.pose.position = _point(seen.skin.points(gap.place, _TEXT))
        label.text = 'not measured: {:.0f} x {:.0f} mm'.format(*(gap.size * 1e3))
        markers.append(label)
    return MarkerArray(markers=markers)


def _colour(values: tuple[float, float, float, float]) -> ColorRGBA:
    red, green, blue, alpha = values
    return ColorRGBA(r=red, g=green, b=blue, a=alpha)


def _point(values: NDArray) -> Point:
    x, y, z = np.asarray(values, float)
    return Point(x=float(x), y=float(y), z=float(z))
