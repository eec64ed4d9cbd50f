"""What the second fit makes of a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.noise.denoising import Denoised


@dataclass(frozen=True, eq=False)
class Refined:
    """A surface's fringes at the nodes and bins.

    Attributes
    ----------
    shift : Denoised
        Phase less the reference's, radians, and its variance.
    level, modulation : ndarray, shape (rows, columns), float32
        Mean and amplitude of the fringes, grey levels.
    measured : ndarray, shape (rows, columns), bool
        Bins that are on the surface.
    told : ndarray, shape (rows, columns), bool
        Bins whose light is the surface's and no shadow's.
    covered : ndarray, shape (rows, columns), float32
        Share of each bin that the surface covers, as far as the fringes' amplitude tells.
    roughness : ndarray, shape (rows, columns), float32
        Root mean square misfit of the bins around each node, in amplitudes.
    wavelength : ndarray, shape (rows, columns), float32
        At which half of a detail's depth is left, pixels.
    astray : ndarray, shape (rows, columns), bool
        Bins on the surface that the fringes explain less well than noise allows.
    relief : bool
        Whether most of the surface is rougher than skin, and than the pixels' noise makes it.
    """

    shift: Denoised
    level: NDArray[np.float32]
    modulation: NDArray[np.float32]
    measured: NDArray[np.bool_]
    told: NDArray[np.bool_]
    covered: NDArray[np.float32]
    roughness: NDArray[np.float32]
    wavelength: NDArray[np.float32]
    astray: NDArray[np.bool_]
    relief: bool
