"""What the page shows of a frame: heat map and photograph with the dents drawn in."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.reporting import drawing
from ftp_dent_ros.inspection.reporting.content import Frame, Report
from ftp_dent_ros.inspection.reporting.records import iso_time
from ftp_dent_ros.inspection.tracking.sightings import ListedDent

_MM = 1000.0
_SCALE_BARS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)


def pictures_of(frame: Frame, report: Report, limit: float) -> dict[str, Any]:
    """Heat map and photograph of a frame, with the outlines of the dents that it shows."""
    view = frame.view
    assert view is not None
    shown = [
        entry
        for entry in (*report.dents, *report.others)
        if any(sighting.frame == frame.number for sighting in entry.sightings)
    ]
    rows, columns = view.deviation.shape
    lines = [closed_outline(entry) for entry in shown]
    places = [drawing.on_grid(line, view) for line in lines]
    heat = [_outline(entry, place) for entry, place in zip(shown, places, strict=True)]
    photograph = None
    if view.photograph is not None:
        photograph = {
            'data': drawing.data_uri(view.photograph, 'image/jpeg'),
            'width': view.size[0],
            'height': view.size[1],
            'outlines': [
                _outline(entry, drawing.on_photograph(line, place, view, report.camera))
                for entry, line, place in zip(shown, lines, places, strict=True)
            ],
        }
    return {
        'number': frame.number,
        'title': frame.name if frame.stamp_ns is None else iso_time(frame.stamp_ns),
        'shows': ', '.join(str(entry.number) for entry in shown),
        'heat': {
            'data': drawing.heat_map(view.deviation, limit),
            'width': columns,
            'height': rows,
            'outlines': heat,
            'bar': _scale_bar(view.points),
        },
        'photograph': photograph,
    }


def closed_outline(entry: ListedDent) -> NDArray[np.float64]:
    """A dent's outline, shape (n, 3); its place alone if it has none."""
    return entry.dent.outline if len(entry.dent.outline) else entry.dent.position[None]


def _outline(entry: ListedDent, pixels: NDArray[np.float64]) -> dict[str, Any]:
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    if not len(pixels):
        pixels = np.zeros((1, 2))
    # The centre of a pixel is at a half in SVG.
    points = ' '.join(f'{u + 0.5:.1f},{v + 0.5:.1f}' for u, v in pixels)
    right, top = pixels[:, 0].max(), pixels[:, 1].min()
    return {
        'points': points,
        'number': entry.number,
        'kind': entry.dent.kind,
        'x': f'{right:.1f}',
        'y': f'{top:.1f}',
    }


def _scale_bar(points: NDArray[np.float32]) -> dict[str, Any] | None:
    """A bar of a round length, a seventh of the picture's width or so, in columns."""
    step = np.linalg.norm(np.diff(points, axis=1), axis=-1)
    if not np.isfinite(step).any():
        return None
    column = float(np.nanmedian(step))
    goal = column * points.shape[1] / 7
    length = min(_SCALE_BARS, key=lambda bar: abs(math.log(bar / goal)))
    return {'length': length / column, 'text': f'{length * _MM:g} mm'}


def scale_of(limit: float) -> dict[str, Any]:
    """The colours of the deviation, and the depths that they stand for."""
    values = np.linspace(-1, 1, 5) * limit * _MM
    return {
        'data': drawing.png(drawing.colour_table()[None]),
        'marks': [f'{value:+.3g}' if value else '0' for value in values],
    }
