"""Dents, measured skin and its gaps as standard messages, and as markers for RViz and Foxglove."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ftp_dent_ros.coding.messages import DENT, ESTIMATES
from ftp_dent_ros.dents.dent import KINDS
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.ros.messages import make_header, to_data
from ftp_dent_ros.survey.footprint import SeenSkin

# By kind; RViz needs an alpha.
_COLOURS = {
    'dent': ColorRGBA(r=0.88, g=0.08, b=0.16, a=1.0),
    'bump': ColorRGBA(r=0.1, g=0.4, b=0.8, a=1.0),
    'step': ColorRGBA(r=0.5, g=0.5, b=0.5, a=1.0),
    'crease': ColorRGBA(r=0.8, g=0.1, b=0.7, a=1.0),
    'gouge': ColorRGBA(r=0.9, g=0.5, b=0.0, a=1.0),
    'other': ColorRGBA(r=0.6, g=0.6, b=0.1, a=1.0),
}
_MEASURED = ColorRGBA(r=0.1, g=0.65, b=0.3, a=0.45)
_GAP = ColorRGBA(r=0.95, g=0.1, b=0.1, a=0.9)


def dents_to_message(entries: Sequence[ListedDent], stamp_ns: int, frame_id: str) -> PointCloud2:
    """sensor_msgs/PointCloud2 with one point a dent: metres, radians, standard uncertainties.

    Besides x, y, z and normal_x, normal_y, normal_z its fields are those of `MeasuredDent`, each
    estimate with ``..._uncertainty``; `kind` is an index into `KINDS`.
    """
    values = np.zeros(len(entries), DENT)
    for row, entry in zip(values, entries, strict=True):
        dent = entry.dent
        for name, vector in (('', dent.position), ('normal_', dent.normal), ('axis_', dent.axis)):
            for axis, value in zip('xyz', vector, strict=True):
                row[f'{name}{axis}'] = value
        for name in ESTIMATES:
            estimate = getattr(dent, name)
            row[name], row[f'{name}_uncertainty'] = estimate.value, estimate.uncertainty
        for name in ('bottom_radius', 'clearance', 'significance'):
            row[name] = getattr(dent, name)
        row['position_uncertainty'] = np.sqrt(np.trace(entry.position_covariance) / 3)
        row['number'], row['sightings'] = entry.number, len(entry.sightings)
        row['kind'], row['is_cut'] = KINDS.index(dent.kind), dent.is_cut
    fields = [
        PointField(
            name=name,
            offset=DENT.fields[name][1],  # type: ignore[index]
            datatype=PointField.FLOAT32 if DENT[name] == '<f4' else PointField.UINT32,
            count=1,
        )
        for name in DENT.names or ()
    ]
    return PointCloud2(
        header=make_header(stamp_ns, frame_id),
        height=1,
        width=len(entries),
        fields=fields,
        is_bigendian=False,
        point_step=DENT.itemsize,
        row_step=DENT.itemsize * len(entries),
        data=to_data(values) if len(entries) else to_data(np.zeros(0, np.uint8)),
        is_dense=True,
    )


def dents_to_markers(entries: Sequence[ListedDent], stamp_ns: int, frame_id: str) -> MarkerArray:
    """visualization_msgs/MarkerArray: outlines, and depths in millimetres as text.

    Its first marker deletes all that were there before.
    """
    header = make_header(stamp_ns, frame_id)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for entry in entries:
        dent = entry.dent
        colour, number = _COLOURS[dent.kind], entry.number
        if len(dent.outline):
            # Metres: as wide, and as far above the skin.
            width = 0.0015
            closed = np.concatenate([dent.outline, dent.outline[:1]]) + width * dent.normal
            line = {'type': Marker.LINE_STRIP, 'scale': Vector3(x=width), 'points': closed}
            markers.append(_marker(header, 'outlines', number, colour, **line))
        text = f'{number}: {dent.depth.value * 1e3:.2f} mm'
        text += '' if dent.kind == 'dent' else f' ({dent.kind})'
        label = _text(text, 0.02, dent.position + 0.02 * dent.normal)
        markers.append(_marker(header, 'depths', number, colour, **label))
    return MarkerArray(markers=markers)


def coverage_to_markers(seen: SeenSkin, stamp_ns: int, frame_id: str) -> MarkerArray:
    """visualization_msgs/MarkerArray: what was measured, green, and gaps, red, with their sizes.

    Its first marker deletes all that were there before; of the gaps, the 20 largest have a label.
    """
    header = make_header(stamp_ns, frame_id)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for name, mask, colour in (
        ('measured', seen.measured, _MEASURED),
        ('gaps', seen.gap_mask, _GAP),
    ):
        corners = seen.strips(mask)
        if len(corners):
            # Two triangles of a strip's four corners.
            triangles = corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
            given = {'type': Marker.TRIANGLE_LIST, 'scale': Vector3(x=1.0, y=1.0, z=1.0)}
            markers.append(_marker(header, name, 0, colour, points=triangles, **given))
    for number, gap in enumerate(seen.gaps[:20]):
        text = 'not measured: {:.0f} x {:.0f} mm'.format(*(gap.size * 1e3))
        label = _text(text, 0.03, seen.skin.points(gap.place, 0.03))
        markers.append(_marker(header, 'sizes', number, _GAP, **label))
    return MarkerArray(markers=markers)


def _marker(
    header: Header,
    ns: str,
    number: int,
    colour: ColorRGBA,
    points: NDArray | tuple[()] = (),
    place: NDArray | tuple[float, ...] = (0.0, 0.0, 0.0),
    **given: Any,
) -> Marker:
    pose = Pose(position=_point(place), orientation=Quaternion(w=1.0))
    drawn = [_point(each) for each in points]
    return Marker(header=header, ns=ns, id=number, color=colour, points=drawn, pose=pose, **given)


def _text(text: str, height: float, place: NDArray) -> dict[str, Any]:
    """Of a marker: letters so high, metres, that face the viewer."""
    scale = Vector3(z=height)
    return {'type': Marker.TEXT_VIEW_FACING, 'text': text, 'scale': scale, 'place': place}


def _point(values: NDArray | tuple[float, ...]) -> Point:
    """On a lattice of 1/4096 m: no drawing shows it, and it is deflated to a third."""
    x, y, z = (round(float(value) * 4096) / 4096 for value in values)
    return Point(x=x, y=y, z=z)
