"""The first fit: about planes at some distances, and the surfaces that its phase ties together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ftp_dent_ros.profilometry.fringe_model.bins import (
    ROUNDING,
    BinGrid,
    GridGeometry,
    Nearest,
    moved,
)
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.local_fit import ASIDE, LocalFit, Windows
from ftp_dent_ros.profilometry.unwrapping import unwrap, wrap

#: Planes, in baselines: a carrier within a factor of 1.5 of the fringes' is near enough.
PLANES = 2.0, 4.0, 8.0
#: Standard deviation of a phase that may be unwrapped: three are a right angle.
DEVIATION = math.pi / 6
# Misfit over that of the windows beside that shows an edge (F test at 1e-3, some 20 bins each),
# and what the phases of both sides are apart where they meet at most of it, radians: edges of
# light, or of one paint, leave 0.07 at most, and blurred code 0.27.
_CLEARER, LEAP = 4.3, 0.3
#: Nodes that a surface has at least: two rows of windows over some fringes.
LEAST_NODES = 30
# Share of the fit that another plane must explain more, so that it is not chosen by noise.
_BETTER = 0.02
#: Least amplitude, levels: beyond the rounding of levels.
FAINTEST = 1.0


@dataclass(frozen=True, eq=False)
class Start:
    """What the first fit gives, at the nodes.

    Attributes
    ----------
    phase : ndarray, shape (rows, nodes), float32
        Unwrapped within each surface, whole turns unknown, radians.
    surface : ndarray, shape (rows, nodes), int32
        Number of the surface, -1 where there are no fringes.
    level, amplitude : ndarray, shape (rows, nodes), float32
        Of the fit about the best plane.
    fringes : ndarray of bool, shape (rows, nodes)
        Where fringes are seen, those at the rims of surfaces too.
    own : LocalFit
        About that phase, of the light that has fringes everywhere.
    colours : list of LocalFit
        The same fringes in each colour.
    """

    phase: NDArray[np.float32]
    surface: NDArray[np.int32]
    level: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    fringes: NDArray[np.bool_]
    own: LocalFit
    colours: list[LocalFit]


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane square to the camera's axis, and the windows of its fringes where all is usable.

    Attributes
    ----------
    at_bins, at_nodes : ndarray, float32
        Phases, radians.
    whole : Windows
    """

    at_bins: NDArray[np.float32]
    at_nodes: NDArray[np.float32]
    whole: Windows

    @classmethod
    def of(cls, geometry: GridGeometry, depth: float) -> Plane:
        """The plane at a depth, metres."""
        grid = geometry.grid
        at_bins, at_nodes = (
            rays.phase(np.full(shape, 1 / depth, np.float32))
            for rays, shape in ((geometry.bins, grid.shape), (geometry.nodes, grid.node_shape))
        )
        usable = np.ones(grid.shape, np.float32)
        return cls(at_bins, at_nodes, Windows(grid, np.cos(at_bins), -np.sin(at_bins), usable))

    def windows(self, grid: BinGrid, usable: NDArray[np.float32]) -> Windows:
        """Windows of its fringes where so much is usable."""
        if usable.all():
            return self.whole
        return Windows(grid, np.cos(self.at_bins), -np.sin(self.at_bins), usable)


def fit_planes(
    grid: BinGrid,
    light: Light,
    planes: Sequence[Plane],
    steps: float,
) -> Start:
    """Fit cosines about the phases of planes; each node takes the plane that explains it best.

    Parameters
    ----------
    planes : sequence of Plane
    steps : float
        Mean square that the code's own steps leave at most, over the amplitude's square.
    """
    fringed, usable = light.unbroken, light.usable
    fits, explained = [], []
    for plane in planes:
        fits.append(plane.windows(grid, usable).fit(fringed))
        share = 1 - fits[-1].rest / np.maximum(fits[-1].total, np.float32(1e-6))
        explained.append(cv2.blur(share, (5, 9)))
    best = int(np.argmax([np.sum(each * (each > 0.5)) for each in explained]))
    explained[best] += _BETTER
    most = np.maximum.reduce(explained)
    chosen = [each == most for each in explained]

    def of(values):
        taken = np.empty_like(most)
        for value, here in zip(values, chosen, strict=True):
            np.copyto(taken, value, where=here)
        return taken

    phase = of([p.at_nodes + f.shift for f, p in zip(fits, planes, strict=True)])
    amplitude = of([f.swing for f in fits])
    rest, level = of([f.rest for f in fits]), of([f.level for f in fits])
    strength = np.square(np.maximum(amplitude, np.float32(1e-3)))
    variance = 2 * rest / (strength * np.float32(grid.bins_in_window))
    fringes = (variance < DEVIATION**2) & (amplitude > FAINTEST)
    wrapped = wrap(phase - planes[best].at_nodes)
    leaps = _leaps(grid, wrapped, rest, np.float32(steps) * strength, fringes)
    unwrapped = unwrap(wrapped, fringes & ~leaps)
    away = Nearest(unwrapped.part >= 0)(unwrapped.phase)
    away = np.where(fringes, away + wrap(wrapped - away), away)
    turn = planes[best].at_bins + grid.at_bins(away)
    windows = Windows(grid, np.cos(turn), -np.sin(turn), light.weight)
    own = windows.fit(fringed)
    own_explained = 1 - own.rest / np.maximum(own.total, np.float32(1e-6))
    surface = _near(unwrapped.part, of(explained), own_explained)
    return Start(
        planes[best].at_nodes + away,
        surface,
        level,
        amplitude,
        fringes,
        own,
        [own if each is fringed else windows.fit(each) for each in light.colours],
    )


def _near(part: NDArray[np.int32], *explained: NDArray[np.float32]) -> NDArray[np.int32]:
    """The surfaces to whose fringes a plane comes near.

    It explains most of what their own phase does. What is seen of others, and of too few nodes,
    is by chance.
    """
    inside = part >= 0
    size, plane, own = (np.bincount(part[inside], x[inside], 1) for x in (inside, *explained))
    return np.where(((plane > own - plane) & (size >= LEAST_NODES))[part], part, -1)


def _leaps(
    grid: BinGrid,
    wrapped: NDArray[np.float32],
    rest: NDArray[np.float32],
    least: NDArray[np.float32],
    fringes: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Nodes of edges in the light across which the phase leaps, or nothing is.

    A window across a step mixes two surfaces and explains its light worse than those beside.
    Where only paint or light leaps, the phase goes on; behind a step of whole fringes its slope
    is another.
    """
    along_u, along_v = grid.fringe[0] / grid.node, grid.fringe[1]
    edge, rim = (np.zeros(wrapped.shape, bool) for _ in range(2))
    leap = np.full(wrapped.shape, -1, np.float32)
    for u, v in ((1, 0), (0, 1)):
        near, far, beside, within = [], [], [], fringes
        seen = fringes.copy()  # what is moved in from beyond the picture is its rim
        if u:
            seen[:, [0, -1]] = False
        else:
            seen[[0, -1]] = False
        for sign in (-1, 1):
            aside = sign * round(u * ASIDE * along_u), sign * round(v * ASIDE * along_v)
            places = [(k * aside[0], k * aside[1]) for k in (1, 2)]
            near.append(moved(wrapped, *places[0]))
            far.append(moved(wrapped, *places[1]))
            beside.append(moved(rest, *places[0]))
            within = within & moved(seen.view(np.uint8), *places[1]).view(bool)
        mixed = fringes & (rest > _CLEARER * (np.minimum(*beside) + ROUNDING) + least)
        rim |= mixed & ~within
        shown = mixed & within
        crest = shown & (rest >= moved(rest, u, v)) & (rest >= moved(rest, -u, -v))
        before, after = (n + wrap(n - f) for n, f in zip(near, far, strict=True))
        leap = np.where(crest, np.maximum(leap, np.abs(wrap(after - before))), leap)
        edge |= shown
    # Along one edge two phases drift, and meet here and there by chance; all of it leaps, or none.
    joined: Any = cv2.dilate(edge.view(np.uint8), np.ones((3, 3), np.uint8))
    count, line = cv2.connectedComponents(joined)
    # The median of no crests is that of line 0, which is no edge.
    of_crests = (np.append(each[leap >= 0], none) for each, none in ((leap, -1), (line, 0)))
    usual = ndimage.median(*of_crests, np.arange(count))
    leaps: NDArray[np.bool_] = rim | (usual > LEAP)[line]
    return leaps
