"""How one map of a skin lies in another: what pieces that look alike in both agree in.

A piece of a map is a dent, or a cloud. Two that look alike propose a motion, and may by chance:
what is believed is what more pieces propose alike than chance would have it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc

from ftp_dent_ros.pose import Pose

#: What proposals of one motion differ by, metres: more than maps are bent between pieces.
REACH = 0.005


def agreeing(
    motions: Sequence[Pose],
    places: NDArray[np.float64],
    pieces: NDArray[np.intp],
    chance: float,
) -> NDArray[np.intp]:
    """Numbers of the proposals that agree, that which most agree with first; none by chance.

    Parameters
    ----------
    motions : sequence of Pose
        Of one map in the other, as n proposals have it.
    places : ndarray, shape (n, 3)
        Of the pieces that propose them, in their map, metres.
    pieces : ndarray, shape (n, k)
        Numbers of these pieces.
    chance : float
        That a motion that is wrong lays a piece within `REACH` of one that looks like it.
    """
    if not len(motions):
        return np.zeros(0, np.intp)
    there = np.stack([motion.apply(places) for motion in motions])
    own = np.einsum('iik->ik', there)
    alike = np.linalg.norm(there - own, axis=-1) < REACH
    # Those beyond the ones that each is made by.
    counts = [len(np.unique(pieces[each])) - pieces.shape[1] for each in alike]
    best = int(np.argmax(counts))
    expected = chance * len(np.unique(pieces))
    # Chance that two maps of other skins are laid on each other: so many or more, by Poisson.
    if len(motions) * gammainc(max(counts[best], 0), expected) > 1e-3:
        return np.zeros(0, np.intp)
    return np.array([best, *np.setdiff1d(np.flatnonzero(alike[best]), best)])
