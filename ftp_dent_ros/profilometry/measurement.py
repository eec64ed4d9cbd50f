"""What one photograph gave."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.profilometry.checks.epipolar import EpipolarCheck

if TYPE_CHECKING:
    from ftp_dent_ros.profilometry.fringe_model.waveform import Waveform


@dataclass(frozen=True)
class Measurement:
    """A cloud, and what is known of the photograph beside it.

    Attributes
    ----------
    cloud : Cloud
    stripe_depth : float
        l_c, the depth of the red stripe and of the virtual reference, metres.
    coverage : Coverage
        What of the lit area has points, and why the rest has none.
    epipolar : EpipolarCheck, optional
        How the rig holds, as far as the rows of the projector tell; None where the pattern does
        not tell them, or too little of it is seen.
    waveform : Waveform, optional
        Of the fringes as the photograph shows them; None if the method does not learn it.
    """

    cloud: Cloud
    stripe_depth: float
    coverage: Coverage
    epipolar: EpipolarCheck | None = None
    waveform: Waveform | None = None

    @property
    def transposed(self) -> Measurement:
        """The same measurement with x for y, and y for x, of pixels as of points."""
        return replace(self, cloud=self.cloud.transposed)
