"""What a report is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.inspection.dent import Waviness
from ftp_dent_ros.inspection.reporting.mesh import Mesh
from ftp_dent_ros.inspection.reporting.rules import Finding, Rules
from ftp_dent_ros.inspection.reporting.skin import Skin
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.inspection.tracking.repeatability import Repeatability
from ftp_dent_ros.inspection.tracking.sightings import ListedDent
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Lens


@dataclass(frozen=True, eq=False)
class View:
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
class Frame:
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
    has_skin : bool
        Whether the image of its skin was there, whose narrow marks tell gouges.
    mesh : Mesh
    pose : Pose, optional
        Of the camera in the report's frame, or of the vehicle where that alone is known.
    covariance : ndarray, shape (6, 6), optional
        Of that pose; None if it is not known.
    pose_age : float, optional
        Seconds between the exposure and its pose.
    coverage : Coverage, optional
        What of the lit skin has no points, and why.
    view : View, optional
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
    has_skin: bool
    mesh: Mesh
    pose: Pose | None = None
    covariance: NDArray[np.float64] | None = None
    pose_age: float | None = None
    coverage: Coverage | None = None
    view: View | None = None


@dataclass(frozen=True, eq=False)
class Report:
    """All that is reported.

    Attributes
    ----------
    source : str
        What was inspected.
    frame_id : str
        Frame of all positions.
    placed : bool
        Whether it is one and the same for all clouds; if not, each cloud stands by itself.
    frames : tuple of Frame
    entries : tuple of ListedDent
        Dents, bumps and steps.
    version : str
        Of the software.
    written_ns : int
        Time of writing, nanoseconds since 1970.
    settings : Settings
        The smallest dents that were looked for.
    rig_name, rig_id : str
        File of the calibration, and the id of its content; empty if none was given.
    camera : Lens, optional
        Of that rig, to draw dents into photographs of clouds in the camera's frame.
    rules : Rules, optional
    repeatability : tuple of Repeatability
        Empty for a single frame.
    refused : tuple of str
        Frames that could not be inspected, and why.
    skipped : tuple of str
        Messages of the bag that could not be used: topic, stamp and why.
    skin : Skin, optional
        All of it, where the clouds were joined.
    remarks : tuple of str
        What else is to be known of the flight.
    """

    source: str
    frame_id: str
    frames: tuple[Frame, ...]
    entries: tuple[ListedDent, ...]
    version: str
    written_ns: int
    settings: Settings
    rig_name: str = ''
    rig_id: str = ''
    camera: Lens | None = None
    rules: Rules | None = None
    repeatability: tuple[Repeatability, ...] = ()
    refused: tuple[str, ...] = ()
    skipped: tuple[str, ...] = ()
    placed: bool = True
    skin: Skin | None = None
    remarks: tuple[str, ...] = ()

    @property
    def dents(self) -> tuple[ListedDent, ...]:
        """Dents alone, the deepest first."""
        dents = [entry for entry in self.entries if entry.dent.kind == 'dent']
        return tuple(sorted(dents, key=lambda entry: -np.nan_to_num(entry.dent.depth.value)))

    @property
    def others(self) -> tuple[ListedDent, ...]:
        """Bumps and steps."""
        return tuple(entry for entry in self.entries if entry.dent.kind != 'dent')

    def findings(self) -> list[tuple[Finding, ...]]:
        """Of each of `dents`; empty ones without rules."""
        if self.rules is None:
            return [()] * len(self.dents)
        together = {e.number: 0 if self.placed else e.best for e in self.dents}
        found: dict[int, tuple[Finding, ...]] = {}
        for group in set(together.values()):
            members = [e for e in self.dents if together[e.number] == group]
            judged = self.rules.judge([e.dent for e in members])
            found.update(zip((e.number for e in members), judged, strict=True))
        return [found[e.number] for e in self.dents]
