"""What the ways to number the fringes have in common: a photograph's surfaces come of each."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.fit.first_fit import Fringes
from ftp_dent_ros.profilometry.least_squares.fit.surface_fit import FittedSurface


class Surfaces(Protocol):
    """Finds the surfaces whose fringes' order is known."""

    def fitted(
        self,
        light: IntensityBins,
        fringes: Fringes,
        lit: NDArray[np.bool_],
        seams: NDArray[np.bool_],
    ) -> list[FittedSurface]:
        """Surfaces in a photograph, each fitted by itself.

        Parameters
        ----------
        light : IntensityBins
        fringes : Fringes
            The first fit.
        lit, seams : ndarray, shape (rows, columns), bool
            Nodes that see fringes of one surface, and those in between that see two.

        Raises
        ------
        NoStripeError, NoFringesError
            No surface can be measured; the reason is that of the last one.
        """
