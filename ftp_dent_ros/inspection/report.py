"""What a report is made of."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.dents.dent import SmallestDent, Waviness
from ftp_dent_ros.dents.rules import Judgement, Rules
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Lens


@dataclass(frozen=True, eq=False)
class DrawnCloud:
    """One cloud as it is drawn.

    Attributes
    ----------
    points : ndarray, shape (rows, columns, 3)
        Of the cloud in its own frame, metres.
    deviation : ndarray, shape (rows, columns)
        Depth below the undeformed contour, metres.
    pose : Pose
        Of the cloud's frame in the report's.
    photograph : bytes, optional
        As JPEG.
    size : (int, int)
        Width and height of the photograph, pixels; zeros without one.
    """

    points: NDArray[np.float32]
    deviation: NDArray[np.float32]
    pose: Pose
    photograph: bytes | None = None
    size: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class ReportedCloud:
    """One cloud that was inspected.

    Attributes
    ----------
    number : int
        From 1.
    name : str
        Of the file, or the time in a bag.
    stamp_ns : int, optional
        Time of the exposure, ROS time.
    area : float
        That was measured, square metres.
    noise : float
        Median standard deviation of a point across the skin, metres.
    findable : tuple of 2 floats
        Depths from which a dent of the smallest width would have been found on half of the
        measured area, and on 95 % of it, metres.
    waviness : tuple of Waviness
    dents, others : int
        How many it shows.
    mesh : ndarray, shape (rows, columns, 4), float32
        As of `mesh_of`, in the report's frame.
    pose : Pose, optional
        Of the camera in the report's frame, or of the vehicle where that alone is known.
    covariance : ndarray, shape (6, 6), optional
        Of that pose; None if it is not known.
    coverage : Coverage, optional
        What of the lit skin has no points, and why.
    view : DrawnCloud, optional
        Kept of the frames that show some dent best.
    """

    number: int
    name: str
    stamp_ns: int | None
    area: float
    noise: float
    findable: tuple[float, float]
    waviness: tuple[Waviness, ...]
    dents: int
    others: int
    mesh: NDArray[np.float32]
    pose: Pose | None = None
    covariance: NDArray[np.float64] | None = None
    coverage: Coverage | None = None
    view: DrawnCloud | None = None


@dataclass(frozen=True, eq=False)
class InspectionReport:
    """All that is reported.

    Attributes
    ----------
    source : str
        What was inspected.
    frame_id : str
        Frame of all positions.
    placed : bool
        Whether it is one and the same for all clouds; if not, each cloud stands by itself.
    frames : tuple of ReportedCloud
    entries : tuple of ListedDent
        Dents, bumps and steps.
    settings : SmallestDent
        The smallest dents that were looked for.
    rig_name, rig_id : str
        File of the calibration, and the id of its content; empty if none was given.
    camera : Lens, optional
        Of that rig, to draw dents into photographs of clouds in the camera's frame.
    rules : Rules, optional
    refused : tuple of str
        Frames that could not be inspected, and why.
    skipped : tuple of str
        Messages of the bag that could not be used: topic, stamp and why.
    skin : dict, optional
        All of it, where the clouds were joined: `ftp_dent_ros.survey.writing.skin_of`.
    remarks : tuple of str
        What else is to be known of the flight.
    written_ns : int
        Time of writing, nanoseconds since 1970.
    """

    source: str
    frame_id: str
    frames: tuple[ReportedCloud, ...]
    entries: tuple[ListedDent, ...]
    settings: SmallestDent
    rig_name: str = ''
    rig_id: str = ''
    camera: Lens | None = None
    rules: Rules | None = None
    refused: tuple[str, ...] = ()
    skipped: tuple[str, ...] = ()
    placed: bool = True
    skin: dict[str, Any] | None = None
    remarks: tuple[str, ...] = ()
    written_ns: int = field(default_factory=time.time_ns)

    @property
    def dents(self) -> tuple[ListedDent, ...]:
        """Dents alone, the deepest first."""
        dents = [entry for entry in self.entries if entry.dent.kind == 'dent']
        return tuple(sorted(dents, key=lambda entry: -np.nan_to_num(entry.dent.depth.value)))

    @property
    def others(self) -> tuple[ListedDent, ...]:
        """Bumps and steps."""
        return tuple(entry for entry in self.entries if entry.dent.kind != 'dent')

    def findings(self) -> list[tuple[Judgement, ...]]:
        """Of each of `dents`; empty ones without rules."""
        if self.rules is None:
            return [()] * len(self.dents)
        together = {e.number: 0 if self.placed else e.best for e in self.dents}
        found: dict[int, tuple[Judgement, ...]] = {}
        for group in set(together.values()):
            members = [e for e in self.dents if together[e.number] == group]
            judged = self.rules.judge([e.dent for e in members])
            found.update(zip((e.number for e in members), judged, strict=True))
        return [found[e.number] for e in self.dents]


def mesh_of(
    points: NDArray[np.float32], deviation: NDArray[np.float32], pose: Pose, vertices: int
) -> NDArray[np.float32]:
    """Every n-th point of a cloud on its grid, so that there are about so many vertices at most.

    Shape (rows, columns, 4): places in the parent frame of `pose`, and depths below the
    undeformed contour, metres; NaN where nothing is measured.
    """
    step = max(1, math.ceil(math.sqrt(deviation.size / vertices)))
    some = (slice(step // 2, None, step),) * 2
    mesh = np.dstack([pose.apply(points[some]), deviation[some]]).astype(np.float32)
    mesh[~np.isfinite(mesh).all(axis=-1)] = np.nan
    return mesh


def away_from_camera(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """Vectors along a cloud's normals, away from its camera; all zero of a single line of points.

    Columns go right and rows down in the image, so their product points away.
    """
    if min(points.shape[:2]) < 2:
        return np.zeros_like(points)
    with np.errstate(invalid='ignore'):
        return np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))


def findable_shares(findable: NDArray[np.float32]) -> tuple[float, float]:
    """Median and 95th percentile of findable depths, metres; NaN where none is known."""
    known = findable[np.isfinite(findable)]
    if not len(known):
        return math.nan, math.nan
    return float(np.median(known)), float(np.percentile(known, 95))
