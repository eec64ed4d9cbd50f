"""What is estimated: which terms of the lenses and of the board, and a rig's numbers in order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.rig.rig import Lens, Rig

# Coefficients k1, k2, p1, p2, k3 as they come in, one candidate after the other.
DISTORTIONS: tuple[tuple[int, ...], ...] = ((), (0,), (0, 1), (0, 1, 2, 3), (0, 1, 2, 3, 4))
SHAPES = ('flat', 'bent', 'free')
# Numbers of a lens, and of a rig: two lenses, a rotation vector and a translation.
LENS = 9
RIG = 2 * LENS + 6


@dataclass(frozen=True)
class Model:
    """What is estimated.

    Attributes
    ----------
    camera, projector : int
        Index into `DISTORTIONS`.
    shape : str
        Of the board: one of `SHAPES`. ``bent`` is a quadratic, ``free`` lets each corner move.
    """

    camera: int = len(DISTORTIONS) - 1
    projector: int = len(DISTORTIONS) - 1
    shape: str = 'flat'


def rig_vector(rig: Rig) -> NDArray[np.float64]:
    """The rig's 24 numbers, in the order of `calibration_record.PARAMETERS`."""
    lenses = [
        np.concatenate([lens.camera_matrix[[0, 1, 0, 1], [0, 1, 2, 2]], lens.distortion])
        for lens in (rig.camera, rig.projector)
    ]
    turn = Rotation.from_matrix(rig.rotation).as_rotvec()
    return np.concatenate([*lenses, turn, rig.translation])


def rig_of(vector: NDArray, like: Rig) -> Rig:
    """The rig of its 24 numbers, with image sizes `like` another's."""
    lenses = []
    for lens, part in ((like.camera, vector[:LENS]), (like.projector, vector[LENS : 2 * LENS])):
        matrix = np.array([[part[0], 0, part[2]], [0, part[1], part[3]], [0, 0, 1]])
        lenses.append(Lens(lens.width, lens.height, matrix, part[4:].copy()))
    rotation = Rotation.from_rotvec(vector[18:21]).as_matrix()
    return Rig(lenses[0], lenses[1], rotation, vector[21:24].copy())
