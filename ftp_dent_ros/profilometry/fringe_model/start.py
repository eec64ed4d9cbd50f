"""The first fit: about planes at some distances, and the surfaces that its phase ties together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fringe_model.bins import BinGrid, nearest
from ftp_dent_ros.profilometry.fringe_model.local_fit import fit_windows
from ftp_dent_ros.profilometry.least_squares.phase_geometry import PhaseGeometry
from ftp_dent_ros.profilometry.unwrapping import unwrap, wrap

#: Planes, in baselines: a carrier within a factor of 1.5 of the fringes' is near enough.
PLANES = 2.0, 4.0, 8.0
# Standard deviation of a phase that may be unwrapped: three are a right angle, and the step
# between nodes that does not tie two of them.
_DEVIATION, _JUMP = math.pi / 6, math.pi / 2
# Misfit over that of the windows beside that shows an edge (F test at 1e-3, some 20 bins each),
# and the leap of phase between its sides that no slope explains, radians.
_CLEARER, _LEAP = 4.3, 0.5
# Windows beside, fringes away, and the share of an edge that must leap.
_BESIDE, _SHARE = (1.25, 2.5), 0.3
# Mean square of rounding to whole levels in a bin, levels^2.
_ROUNDING = 0.05
# Share of the fit that another plane must explain more, so that it is not chosen by noise.
_BETTER = 0.02
# Least amplitude, levels: beyond the rounding of levels.
_FAINTEST = 1.0


@dataclass(frozen=True, eq=False)
class Start:
    """What the first fit gives, at the nodes.

    Attributes
    ----------
    phase : ndarray, shape (rows, nodes), float32
        Unwrapped within each surface, whole turns unknown, radians.
    surface : ndarray, shape (rows, nodes), int32
        Number of the surface, -1 where there are no fringes.
    level, amplitude, rest : ndarray, shape (rows, nodes), float32
        Of the fit; `rest` is the mean square that it leaves.
    reference : ndarray, shape (rows, columns), float32
        Phase of the best plane, at the bins.
    away : ndarray, shape (rows, nodes), float32
        Phase about that plane's.
    """

    phase: NDArray[np.float32]
    surface: NDArray[np.int32]
    level: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    rest: NDArray[np.float32]
    reference: NDArray[np.float32]
    away: NDArray[np.float32]


def fit_planes(
    grid: BinGrid,
    light: NDArray[np.float32],
    usable: NDArray[np.float32],
    references: list[tuple[NDArray[np.float32], NDArray[np.float32]]],
) -> Start:
    """Fit cosines about the phases of planes; each node takes the plane that explains it best.

    Parameters
    ----------
    references : list of (ndarray, ndarray)
        Phases of each plane at the bins and at the nodes.
    """
    fits, explained = [], []
    for at_bins, _ in references:
        fits.append(fit_windows(grid, light, np.cos(at_bins), -np.sin(at_bins), usable))
        share = 1 - fits[-1].rest / np.maximum(fits[-1].total, np.float32(1e-6))
        explained.append(cv2.blur(share, (5, 9)))
    best = int(np.argmax([each[each > 0.5].sum() for each in explained]))
    explained[best] += _BETTER
    chosen = np.argmax(explained, axis=0)

    def of(values):
        return np.choose(chosen, values).astype(np.float32)

    phase = of(
        [n + np.arctan2(f.slope, f.amplitude) for f, (_, n) in zip(fits, references, strict=True)]
    )
    amplitude = of([np.hypot(f.slope, f.amplitude) for f in fits])
    rest, level = of([f.rest for f in fits]), of([f.level for f in fits])
    strength = np.square(np.maximum(amplitude, np.float32(1e-3)))
    variance = 2 * rest / (strength * grid.bins_in_window)
    fringes = (variance < (_DEVIATION / 3) ** 2) & (amplitude > _FAINTEST)
    wrapped = wrap(phase - references[best][1])
    tied = fringes & ~_leaps(grid, wrapped, rest, fringes)
    unwrapped = unwrap(wrapped, tied, jump=_JUMP)
    away = nearest(unwrapped.phase, unwrapped.part >= 0)
    away = np.where(fringes, away + wrap(wrapped - away), away)
    return Start(
        *(references[best][1] + away, unwrapped.part, level, amplitude, rest),
        *(references[best][0], away),
    )


def _leaps(
    grid: BinGrid,
    wrapped: NDArray[np.float32],
    rest: NDArray[np.float32],
    fringes: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Nodes where the phases of both sides do not meet, and the light shows an edge.

    A window across a step mixes two surfaces and explains its light worse than those beside.
    Where only paint or light leaps, the phase goes on.
    """
    along_u, along_v = grid.fringe[0] / grid.node, grid.fringe[1]
    edge, leaps = (np.zeros(wrapped.shape, bool) for _ in range(2))
    for u, v in ((1, 0), (0, 1)):
        ends, beside, within = [], [], fringes
        for sign in (-1, 1):
            near, far = (
                (round(sign * k * u * along_u), round(sign * k * v * along_v)) for k in _BESIDE
            )
            at_near, at_far = _moved(wrapped, *near), _moved(wrapped, *far)
            ends.append(at_near + wrap(at_near - at_far))
            beside.append(_moved(rest, *near))
            within = within & _moved(fringes, *near)
        shown = within & (rest > _CLEARER * (np.minimum(*beside) + _ROUNDING))
        edge |= shown
        leaps |= shown & (np.abs(wrap(ends[1] - ends[0])) > _LEAP)
    # Along one edge two phases drift, and meet here and there by chance; all of it leaps, or none.
    joined: Any = cv2.dilate(edge.view(np.uint8), np.ones((3, 3), np.uint8))
    _, line = cv2.connectedComponents(joined)
    share = np.bincount(line[leaps], minlength=line.max() + 1) / np.maximum(
        np.bincount(line[edge], minlength=line.max() + 1), 1
    )
    return (joined > 0) & (share[line] > _SHARE)


def _moved(nodes: NDArray[Any], columns: int, rows: int) -> NDArray[Any]:
    """The value of the node so far to the right and below, at the border the border's."""
    row, column = (
        np.clip(np.arange(n) + by, 0, n - 1)
        for n, by in zip(nodes.shape, (rows, columns), strict=True)
    )
    return nodes[np.ix_(row, column)]


def plane_phases(
    bins: PhaseGeometry, nodes: PhaseGeometry, grid: BinGrid, baseline: float
) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Phases at bins and nodes of planes square to the camera's axis."""
    found = []
    for distance in PLANES:
        inverse = np.float32(1 / (distance * baseline))
        found.append(
            (
                bins.phase(np.full(grid.shape, inverse, np.float32)),
                nodes.phase(np.full(grid.node_shape, inverse, np.float32)),
            )
        )
    return found
