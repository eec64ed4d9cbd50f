"""Motions between two surveys that are worth a try, by pairs of neighbouring dents.

Two neighbours that are as far apart in both surveys, and of like sizes, propose one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.pose import Pose

Array = NDArray[np.float64]

#: Standard deviation of a dent's centre in its survey, metres.
PLACE = 4e-4
#: Standard deviations within which two are taken for the same.
GATE = 4.0
# Of the distance of two neighbours, per metre, beside: what maps stretch.
_STRETCH = 4e-3
# Neighbours that a dent makes pairs with; motions that are tried.
_NEIGHBOURS, _TRIED = 8, 400


def motions_between(
    earlier: Sequence[MeasuredDent], later: Sequence[MeasuredDent], agree: Array
) -> list[Pose]:
    """Motions that lay two neighbours of the later survey on two of the earlier one.

    Parameters
    ----------
    earlier, later : sequence of MeasuredDent
        Each in its survey's frame.
    agree : ndarray, shape (n, m)
        How unlike the sizes of any two are, as `agreement` gives it; infinite where they cannot
        be the same.

    Returns
    -------
    list of Pose
        Those of long pairs of like sizes first.
    """
    a, b = _neighbours(earlier), _neighbours(later)
    if not len(a) or not len(b):
        return []
    lengths = [_lengths(each, pairs) for each, pairs in ((earlier, a), (later, b))]
    tolerance = GATE * np.hypot(2 * PLACE, _STRETCH * lengths[0])
    good = np.abs(lengths[0][:, None] - lengths[1]) < tolerance[:, None]
    sizes = agree[a[:, 0]][:, b[:, 0]] + agree[a[:, 1]][:, b[:, 1]]
    good &= np.isfinite(sizes)
    rows, columns = np.nonzero(good)
    # Long ones of like sizes say the most.
    order = np.argsort(sizes[rows, columns] - np.log(lengths[0][rows]), kind='stable')[:_TRIED]
    motions = (_motion(earlier, later, a[rows[k]], b[columns[k]]) for k in order)
    return [motion for motion in motions if motion is not None]


def _motion(
    earlier: Sequence[MeasuredDent],
    later: Sequence[MeasuredDent],
    there: NDArray[np.intp],
    here: NDArray[np.intp],
) -> Pose | None:
    """Motion by two places and the skin's normals at them."""
    frames = []
    for dents, (first, second) in ((earlier, there), (later, here)):
        along = dents[second].position - dents[first].position
        normal = dents[first].normal + dents[second].normal
        across = np.cross(normal, along)
        if np.linalg.norm(across) < 1e-9:
            return None
        along, across = along / np.linalg.norm(along), across / np.linalg.norm(across)
        middle = (dents[first].position + dents[second].position) / 2
        frames.append((np.stack([along, across, np.cross(along, across)], axis=1), middle))
    (one, origin), (other, start) = frames
    turn = Rotation.from_matrix(one @ other.T)
    return Pose(turn, origin - turn.apply(start))


def _neighbours(dents: Sequence[MeasuredDent]) -> NDArray[np.intp]:
    """Ordered pairs of each whole dent and its neighbours, shape (n, 2)."""
    whole = np.array([k for k, dent in enumerate(dents) if not dent.is_cut], np.intp)
    if len(whole) < 2:
        return np.zeros((0, 2), np.intp)
    places = np.stack([dents[k].position for k in whole])
    _, index = cKDTree(places).query(places, k=min(_NEIGHBOURS + 1, len(whole)))
    first = np.repeat(np.arange(len(whole)), index.shape[1] - 1)
    return np.stack([whole[first], whole[index[:, 1:].ravel()]], axis=1)


def _lengths(dents: Sequence[MeasuredDent], pairs: NDArray[np.intp]) -> Array:
    places = np.stack([dent.position for dent in dents])
    return np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1)
