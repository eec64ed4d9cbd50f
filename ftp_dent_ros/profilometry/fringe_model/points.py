"""From the fit to surfaces of points: the phase of each denoised, and where it ends."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fringe_model.bins import (
    ROUNDING,
    GridGeometry,
    Nearest,
    deconvolved,
    dilated,
    wider_than_windows,
)
from ftp_dent_ros.profilometry.fringe_model.denoising import denoise
from ftp_dent_ros.profilometry.fringe_model.pixels import RIM, SHARE, Sheet
from ftp_dent_ros.profilometry.fringe_model.quadric import quadric_through
from ftp_dent_ros.profilometry.fringe_model.solver import FringeFit
from ftp_dent_ros.profilometry.fringe_model.start import DEVIATION, LEAP, LEAST_NODES

# Mean square of the residual about a node over its scale, from which on it makes the phase less
# certain.
_UNUSUAL = 3.0
# Share of the bins about that must not be clipped: crests may be.
_SEEN = 0.4
# Standard deviations of the residuals that an amplitude shows fringes by.
_CHANCE = 2.0
# Standard deviation of a phase that is published, radians: half of that which is unwrapped.
_DEVIATION = DEVIATION / 2
# Amplitude over the strongest beside, below which a node is at a rim, half of it dark.
_FAINTER = 0.6
# Gain of the finest octave below which skin is as its surroundings in a gap; and nodes across two
# windows, one at each side of a gap.
_SHAPELESS, _ACROSS = 0.5, np.ones((5, 5), np.uint8)
# A node and those beside it.
_ABOUT = 3, 3
# Rows and columns of nodes at the rim into which light from beside the surface reaches.
_BOTH = 1, 2


class Points:
    """The points of one photograph, to which surfaces are added.

    Parameters
    ----------
    geometry : GridGeometry
    fit : FringeFit
    usable : ndarray, shape (rows, columns)
        Share of the bins that is not clipped, 0 to 1.
    light : ndarray, shape (rows, columns)
        That the fit explains.
    """

    def __init__(
        self,
        geometry: GridGeometry,
        fit: FringeFit,
        usable: NDArray[np.float32],
        light: NDArray[np.float32],
    ) -> None:
        self._light = light
        grid, nodes = geometry.grid, geometry.nodes
        self._grid, self._bins, self._nodes, self._fit = grid, geometry.bins, nodes, fit
        self._phase = grid.at_nodes(fit.phase)
        level, amplitude = (np.maximum(grid.at_nodes(x), 0.5) for x in (fit.level, fit.amplitude))
        self._amplitude = amplitude
        share = grid.at_nodes(usable)
        self._usable = share > 0
        self._seen: Any = cv2.blur(share, _ABOUT)
        rest: Any = cv2.blur(grid.at_nodes(usable * fit.residual * fit.residual), _ABOUT)
        rest /= np.maximum(self._seen, np.float32(1e-3))
        scale = np.maximum(fit.scale, np.float32(ROUNDING))
        self._good = (self._seen > _SEEN) & (
            grid.at_nodes(fit.amplitude) > _CHANCE * np.sqrt(scale)
        )
        beside: Any = cv2.dilate(amplitude, np.ones(_ABOUT, np.uint8))
        self._whole = amplitude > _FAINTER * beside
        unusual = np.maximum(rest - _UNUSUAL * fit.scale, 0)
        self._unexplained = 2 * unusual / np.square(np.maximum(amplitude, 1))
        self._inverse, v_p = nodes.meet(self._phase)
        amplitude = amplitude / nodes.pattern.row_contrast(np.nan_to_num(v_p)).astype(np.float32)
        self._changes = np.log(amplitude / level), np.log(amplitude)
        self.sheets: list[Sheet] = []
        self.measured = np.zeros(grid.node_shape, bool)
        #: Phase of each surface at the nodes, and where it is certain, on the panel or beyond.
        self.surfaces: list[tuple[NDArray[np.float32], NDArray[np.bool_]]] = []
        self._at_stripe: list[NDArray[np.floating]] = []

    @property
    def stripe_depth(self) -> float:
        """Depth where the phase is zero, or of all that is measured; NaN of nothing."""
        return float(np.median(np.concatenate(self._at_stripe))) if self._at_stripe else math.nan

    def add(self, inside: NDArray[np.bool_]) -> None:
        """Add the surface of some nodes."""
        grid, fit = self._grid, self._fit
        rim = dilated(self._usable & ~inside, *_BOTH)
        inside = inside & self._good & np.isfinite(self._inverse)  # a ray may miss its plane
        if np.count_nonzero(inside) < LEAST_NODES:
            return
        places = grid.node_places
        quadric = quadric_through(places, self._inverse, inside)
        smooth = self._nodes.phase(quadric.at(*places))
        coarse = self._phase - smooth
        inside, surface = inside & self._whole, inside
        denoised = denoise(
            grid,
            coarse,
            [x - quadric_through(places, x, surface).at(*places) for x in self._changes],
            fit.ratios,
            inside / (1 + self._unexplained / np.float32(_DEVIATION**2)),
            fit.variance,
        )
        variance, noise = (
            np.maximum(each, 0) + self._unexplained for each in (denoised.variance, denoised.noise)
        )
        variance += fit.systematic
        certain = inside & ~rim & (variance < _DEVIATION**2)
        self.surfaces.append((smooth + denoised.phase, certain))
        if not certain.any():
            return
        off = np.square(coarse - denoised.phase)
        plain = surface & ~rim & (denoised.finest < _SHAPELESS) & (off < LEAP**2)
        known, on_surface = Nearest(certain), Nearest(inside)
        at_nodes = smooth + known(denoised.phase)
        # What is finer than the nodes is as good as the finest octave.
        finest = grid.at_bins(np.clip(on_surface(denoised.finest), 0, 1))
        away, coarse = (
            grid.at_bins(deconvolved(on_surface(each), grid.node, 1))
            for each in (denoised.phase, coarse)
        )
        smooth = self._bins.phase(quadric.at(*grid.bin_places))
        phase = smooth + away + finest * (fit.phase - smooth - coarse)
        # In a gap the fit's own phase shows how far off that of the rim may be.
        deviations = self._nodes.per_radian(at_nodes) * np.sqrt(
            [known(variance) + off * (plain & ~certain), known(noise)]
        )
        self._keep(
            certain,
            self._ends(inside, certain, plain),
            quadric,
            phase,
            at_nodes,
            deviations,
        )

    def _keep(self, certain, ends, quadric, phase, at_nodes, deviations) -> None:
        """Keep what is certain enough, and lit by the panel."""
        grid, (deviation, noise) = self._grid, deviations
        sure, share, good, gaps = ends
        inverse, _ = self._bins.meet(phase)
        rim = self._nodes.within_panel(at_nodes)
        self.measured |= good & (rim > RIM)
        own = grid.repeated(certain & good) & np.isfinite(inverse)
        if not own.any():
            return
        stripe = own & (np.abs(phase) < math.pi)
        self._at_stripe.append(1 / inverse[stripe if stripe.any() else own])
        nearest, smooth = Nearest(own), quadric.at(*grid.bin_places)
        away, raw = (
            deconvolved(nearest((each - smooth).astype(np.float32)), grid.step, grid.rows)
            for each in (inverse, self._bins.meet(self._fit.phase)[0])
        )
        # In a gap nothing is measured.
        raw[grid.repeated(gaps)] = np.nan
        self.sheets.append(
            Sheet(
                quadric,
                away,
                raw,
                deviation,
                noise,
                self._amplitude,
                share,
                sure,
                good,
                rim,
            )
        )

    def _ends(self, inside, certain, plain):
        """Nodes inside a surface, the share of its light (eq. 11), nodes with points, and gaps.

        Beside another surface's fringes, and at small holes, the share tells nothing. Gaps that
        are narrower than two windows, in `plain` skin, have points, too.
        """
        along_u, along_v = self._grid.fringe
        # A fringe from a surface on the light is another's.
        reach = [math.ceil(n) for n in (along_v, along_u / self._grid.node)]
        inner = ~dilated(~certain, 1, 1)
        other = wider_than_windows(self._good & ~inside)
        near, others = (dilated(each, *reach) for each in (certain, other))
        at_end = dilated(~near, *(2 * n + 1 for n in reach)) & ~others
        share = self._share(near, inner)
        sure = inner | (certain & ~at_end)
        lit = near & at_end & (share > SHARE) & (self._seen > _SEEN)
        closed: Any = cv2.morphologyEx(certain.view(np.uint8), cv2.MORPH_CLOSE, _ACROSS)
        gaps = plain & ~certain & ~others & ~at_end & (closed > 0)
        return sure | gaps, share, sure | lit | gaps, gaps

    def _share(self, near, inner: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Share of the surface's light, led on beyond it, which is there (eq. 11)."""
        grid, fit = self._grid, self._fit
        from_inside = Nearest(inner)
        level, amplitude = (
            grid.at_bins(from_inside(grid.at_nodes(x))) for x in (fit.level, fit.amplitude)
        )
        beyond = grid.at_bins(Nearest(~near)(grid.at_nodes(self._light)))
        surface = level + amplitude * fit.wave - beyond
        here = grid.at_nodes((self._light - beyond) * np.sign(surface))
        share = here / np.maximum(grid.at_nodes(np.abs(surface)), 1)
        return np.minimum(share, 1 / np.maximum(share, np.float32(1e-3)))  # more is another's
