"""What an inspection of the simulated skin should find, and which of it was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from ftp_dent_ros.simulation.dents import DIRECTIONS, Dent
from ftp_dent_ros.simulation.surface import Panel, Surface

# Of outlines and borders.
_CORNERS = 72


@dataclass(frozen=True, eq=False)
class TrueDent:
    """A simulated dent in the frame of its surface.

    Attributes
    ----------
    kind : str
        ``'dent'``, ``'crease'``, ``'gouge'`` or ``'bump'``.
    position : ndarray, shape (3,)
        Centre on the undented skin, metres.
    normal, axis : ndarray, shape (3,)
        Unit vectors outward, and along the length.
    depth : float
        Along the normal, metres; a bulge's is negative.
    length, width : float
        Of the contour at 10 % of the depth, metres.
    outline : ndarray, shape (n, 3)
        That contour on the undented skin, metres.
    border : ndarray, shape (n, 3)
        The ellipse of its full axes, on the undented skin, metres.
    """

    kind: str
    position: NDArray[np.float64]
    normal: NDArray[np.float64]
    axis: NDArray[np.float64]
    depth: float
    length: float
    width: float
    outline: NDArray[np.float64]
    border: NDArray[np.float64]


def true_dents(surface: Surface) -> tuple[TrueDent, ...]:
    """Dents of a surface's panels, in the surface's frame."""
    return tuple(_true_dent(panel, dent) for panel in surface.panels for dent in panel.dents)


def _true_dent(panel: Panel, dent: Dent) -> TrueDent:
    angles = np.linspace(0, 2 * np.pi, _CORNERS, endpoint=False)
    along = np.array([np.cos(dent.angle), np.sin(dent.angle)])
    across = np.array([-along[1], along[0]])
    length, width = dent.size()

    def on_skin(offsets: NDArray) -> NDArray[np.float64]:
        x, y = (np.array([dent.x, dent.y]) + offsets).T
        height, _, _ = panel.bare_height(x, y)
        return panel.pose.apply(np.stack([x, y, height], axis=-1))

    a, b = dent.length / 2 * np.cos(angles), dent.width / 2 * np.sin(angles)
    (centre,) = on_skin(np.zeros((1, 2)))
    (normal,) = panel.bare.normal(np.array([dent.x]), np.array([dent.y]))
    into = panel.pose.rotation.apply([0.0, 0.0, 1.0])
    (ahead,) = on_skin(1e-4 * along[None])
    return TrueDent(
        kind=dent.kind,
        position=centre,
        normal=normal,
        axis=(ahead - centre) / np.linalg.norm(ahead - centre),
        # The panel's dents are added along its z axis.
        depth=float(-dent.depth * (into @ normal)),
        length=length,
        width=width,
        outline=on_skin(dent.outline()[:: DIRECTIONS // _CORNERS]),
        border=on_skin(a[:, None] * along + b[:, None] * across),
    )


def match_truth(
    found: ArrayLike,
    true: ArrayLike,
    reach: ArrayLike,
) -> dict[int, int]:
    """Pairs of true and found places, as many as can be, and of these the nearest by their reach.

    Parameters
    ----------
    found : array_like, shape (n, 3)
        Metres.
    true : array_like, shape (m, 3)
        In the same frame.
    reach : array_like, broadcast to shape (n, m)
        How far a found place may lie off a true one, metres.

    Returns
    -------
    dict
        Index of the one found, by that of the true one: each at most once.
    """
    places = [np.asarray(each, float).reshape(-1, 3) for each in (found, true)]
    apart = cdist(*places)
    allowed = apart <= np.broadcast_to(np.asarray(reach, float), apart.shape)
    # What a pair costs that cannot be: more than all that can, each of which costs 1 at most.
    cost = np.divide(apart, reach, out=np.full(apart.shape, 1e6), where=allowed)
    rows, columns = linear_sum_assignment(cost)
    return {
        int(column): int(row)
        for row, column in zip(rows, columns, strict=True)
        if allowed[row, column]
    }


def true_index(position: NDArray[np.float64], truth: Sequence[TrueDent]) -> int | None:
    """The true dent within whose length a position lies; the nearest of several."""
    apart = [float(np.linalg.norm(true.position - position)) for true in truth]
    near = [i for i, true in enumerate(truth) if apart[i] <= true.length / 2]
    return min(near, key=lambda i: apart[i], default=None)
