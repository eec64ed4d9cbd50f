"""What the page's 3-D view shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.reporting import drawing
from ftp_dent_ros.inspection.reporting.content import Report
from ftp_dent_ros.inspection.reporting.pictures import closed_outline


def scene_of(report: Report, limit: float) -> dict[str, Any]:
    """What the 3-D view shows, about the middle of it all."""
    frames = report.frames
    if not report.placed:
        # Each is where its camera was: one is shown.
        frames = tuple(frame for frame in frames if frame.view)[:1]
    shown = {frame.number for frame in frames}
    found = [frame.mesh.points[np.isfinite(frame.mesh.points).all(-1)] for frame in frames]
    every = np.concatenate([np.zeros((0, 3), np.float32), *found]).astype(float)
    if not len(every):
        return {'meshes': []}
    origin = (every.min(axis=0) + every.max(axis=0)) / 2
    inward = _mean([frame.mesh.inward for frame in frames])
    down = _mean([np.diff(frame.mesh.points, axis=0) for frame in frames])
    meshes = [frame.mesh.packed(origin) for frame in frames]
    return {
        'meshes': [mesh for mesh in meshes if mesh],
        'radius': float(np.linalg.norm(every - origin, axis=1).max()),
        'inward': inward,
        'down': down,
        'limit': limit,
        'colours': drawing.colour_table().ravel().tolist(),
        'dents': [
            {
                'number': entry.number,
                'kind': entry.dent.kind,
                'position': (entry.dent.position - origin).tolist(),
                'outline': np.round(closed_outline(entry) - origin, 5).ravel().tolist(),
                'normal': entry.dent.normal.tolist(),
            }
            for entry in (*report.dents, *report.others)
            if shown & {sighting.frame for sighting in entry.sightings}
        ],
    }


def _mean(fields: Sequence[NDArray]) -> list[float]:
    vectors = [field[np.isfinite(field).all(-1)] for field in fields if field.size]
    total = np.concatenate([np.zeros((0, 3)), *vectors]).sum(axis=0)
    length = float(np.linalg.norm(total))
    return [float(value) for value in total / length] if length else [0.0, 0.0, 1.0]
