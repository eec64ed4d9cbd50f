"""From the fit to points: the phase of each surface denoised, and met with the camera's rays."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.fringe_model.bins import WIDTH, BinGrid, Nearest, deconvolved
from ftp_dent_ros.profilometry.fringe_model.denoising import Denoised, denoise
from ftp_dent_ros.profilometry.fringe_model.quadric import quadric_through
from ftp_dent_ros.profilometry.fringe_model.solver import FringeFit
from ftp_dent_ros.profilometry.phase_geometry import PhaseGeometry, rays_at
from ftp_dent_ros.rig.rig import Rig

# Mean square of the residual about a bin over its scale, beyond which its light is not explained
# (F test at 1e-6, some 12 bins), and from which on it makes the phase less certain.
_UNEXPLAINED, _UNUSUAL = 30.0, 3.0
# Standard deviations of what noise alone leaves so unevenly.
_CHANCE = 2.0
# Amplitude over the residuals' scale that shows fringes: two standard deviations.
_VISIBLE = 2.0
# Share of the bins about that must not be clipped: crests may be.
_SEEN = 0.4
# Mean square of rounding to whole levels in a bin, levels^2.
_ROUNDING = 0.05
# Share of a node's bins that must be on the surface, for its phase, and for the quadric.
_MOST, _ALL = 0.6, 0.95
# Nodes that a surface has at least: two rows of windows over some fringes.
_LEAST_NODES = 30
# Standard deviation of a phase that is published, radians: three are a right angle.
_DEVIATION = math.pi / 6
# Standard deviation of a point over its distance, beyond which it is none.
_FAR = 0.1
# Fringes from a surface on where the light is another's; standard deviation of the means of light
# at its rim.
_FAR_OFF, _RIM_WIDTH = 1.0, 0.15
# Share of the light that is there at the rim, which the lens blurs.
_SHARE = 0.8
# Projector pixels at the panel's rim that the lens blurs.
RIM = 1.5


class Points:
    """The cloud of one photograph, to which surfaces are added.

    Parameters
    ----------
    rig, pattern, grid, bins, nodes
        As of the method; `bins` and `nodes` are the grid's rays.
    stride : int
        The cloud has every `stride`-th pixel.
    fit : FringeFit
    usable : ndarray, shape (rows, columns)
        1 where the light is not clipped.
    light : ndarray, shape (rows, columns)
        That the fit explains.
    """

    def __init__(
        self,
        rig: Rig,
        pattern: Pattern,
        grid: BinGrid,
        bins: PhaseGeometry,
        nodes: PhaseGeometry,
        stride: int,
        fit: FringeFit,
        usable: NDArray[np.float32],
        light: NDArray[np.float32],
    ) -> None:
        self._light = light
        self._rig, self._pattern, self._grid = rig, pattern, grid
        self._bins, self._nodes, self._stride, self._fit = bins, nodes, stride, fit
        self._usable = usable > 0
        seen = grid.around(grid.around(usable))
        square = usable * fit.residual * fit.residual
        rest = grid.around(grid.around(square)) / np.maximum(seen, 1e-3)
        explained = rest < _UNEXPLAINED * np.maximum(fit.scale, _ROUNDING)
        visible = fit.amplitude > _VISIBLE * np.sqrt(np.maximum(fit.scale, 0))
        self._seen = seen
        self._good = explained & visible & (seen > _SEEN)
        amplitude = np.maximum(fit.amplitude, 1)
        self._unexplained = 2 * np.maximum(rest - _UNUSUAL * fit.scale, 0) / np.square(amplitude)
        # Detail that the windows do not resolve leaves more on the flanks than on the crests.
        wave, slope = fit.waveform.at(fit.phase)
        uneven = square * (slope * slope - wave * wave)
        chance = _CHANCE * math.sqrt(1.5 / grid.bins_in_window) * fit.scale
        detail = np.maximum(grid.smooth_bins(uneven, WIDTH) - chance, 0)
        self._unexplained += 4 * detail / np.square(amplitude)
        _, v_p = bins.meet(fit.phase)
        by_rows = pattern.row_contrast(np.nan_to_num(v_p)).astype(np.float32)
        level, amplitude = (np.maximum(each, 0.5) for each in (fit.level, fit.amplitude / by_rows))
        self._changes = np.log(amplitude / level), np.log(amplitude)
        columns, rows = (np.arange(0, n, stride) for n in (grid.width, grid.height))
        self._pixels, self._rays = (columns, rows), rays_at(rig.camera, columns, rows)
        shape = self._rays.shape[:2]
        unknown = (np.full(shape, np.nan, np.float32) for _ in range(2))
        points = np.full((*shape, 3), np.nan, np.float32)
        self.cloud = Cloud(points, np.zeros(shape, np.float32), *unknown)
        self.measured = np.zeros(grid.shape, bool)
        #: Phase of each surface at the bins, and where there are fringes, of the panel or beyond.
        self.surfaces: list[tuple[NDArray[np.float32], NDArray[np.bool_]]] = []
        self._at_stripe: list[NDArray[np.float32]] = []

    @property
    def stripe_depth(self) -> float:
        """Depth where the phase is zero, or of all that is measured; NaN of nothing."""
        return float(np.median(np.concatenate(self._at_stripe))) if self._at_stripe else math.nan

    def add(self, inside: NDArray[np.bool_], reference: NDArray[np.float32]) -> None:
        """Add the surface of some bins, whose phase is near a reference's."""
        grid, fit = self._grid, self._fit
        inside = inside & self._good
        share = grid.at_nodes(inside.astype(np.float32))

        def mean(bins: NDArray[Any]) -> NDArray[np.float32]:
            within = np.where(inside, bins, 0).astype(np.float32)
            return grid.at_nodes(within) / np.maximum(share, np.float32(1e-3))

        at_nodes, bins = grid.node_places, grid.bin_places
        inverse, _ = self._nodes.meet(mean(fit.phase - reference) + grid.at_nodes(reference))
        nodes = (share > _MOST) & np.isfinite(inverse)  # a ray may miss its plane
        if np.count_nonzero(nodes) < _LEAST_NODES:
            return
        whole = nodes & (share > _ALL)
        at = whole if np.count_nonzero(whole) > _LEAST_NODES else nodes
        quadric = quadric_through(at_nodes, inverse, at)
        smooth = self._bins.phase(quadric.at(*bins))
        changes = [
            each - quadric_through(at_nodes, each, nodes).at(*at_nodes)
            for each in map(mean, self._changes)
        ]
        away = fit.phase - smooth
        coarse = mean(away)
        denoised = denoise(grid, coarse, changes, nodes.astype(np.float32))

        on_surface = Nearest(nodes)

        def at_bins(values: NDArray[np.float32]) -> NDArray[np.float32]:
            return grid.at_bins(on_surface(values))

        # What is finer than the nodes is as good as the finest octave.
        finest = np.clip(at_bins(denoised.finest), 0, 1)
        denoised_phase, coarse = (
            grid.at_bins(deconvolved(on_surface(each), grid.node, 1))
            for each in (denoised.phase, coarse)
        )
        phase = smooth + denoised_phase + finest * (away - coarse)
        self._publish(inside, quadric, phase, denoised, at_bins)

    def _publish(self, inside, quadric, phase, denoised: Denoised, at_bins) -> None:
        """Put what is certain enough, and lit by the panel, into the cloud."""
        variance = np.maximum(at_bins(denoised.variance), 0) + self._unexplained
        inverse, v_p = self._bins.meet(phase)
        certain = (variance < _DEVIATION**2) & np.isfinite(inverse)
        good = inside & certain
        self.surfaces.append((phase, good))
        # Light from beside the surface reaches into the bins at its rim.
        box = np.ones(self._grid.half_fringe[::-1], np.uint8)
        beside = cv2.dilate((self._usable & ~good).view(np.uint8), box) > 0
        rim = within_panel(self._rig, self._pattern, phase, v_p)
        whole = good & ~beside
        if not whole.any():
            return
        inner = cv2.erode(whole.view(np.uint8), box) > 0
        reach = tuple(2 * math.ceil(_FAR_OFF * n) + 1 for n in self._grid.fringe)
        near, others = (
            cv2.dilate(each.view(np.uint8), np.ones(reach[::-1], np.uint8)) > 0
            for each in (whole, self._good & ~inside)
        )
        share = self._share(near, inner, phase)
        # Beside another surface's fringes, and at small holes, the share tells nothing.
        at_end = cv2.blur((~near).astype(np.float32), tuple(2 * n + 1 for n in reach)) > 0
        sure = inner | (whole & (others | ~at_end))
        lit = (share > _SHARE) & (self._seen > _SEEN)
        good = sure | (near & at_end & ~others & lit & certain)
        own = whole & good
        self.measured |= good & (rim > RIM)
        stripe = good & (np.abs(phase) < math.pi)
        self._at_stripe.append(1 / inverse[stripe if stripe.any() else good])
        away = np.where(own, inverse - quadric.at(*self._grid.bin_places), 0)
        led_on = Nearest(own)
        away = led_on(away.astype(np.float32))
        away = self._at_pixels(deconvolved(away, self._grid.step, self._grid.rows))
        z = 1 / (quadric.at(*self._grid.places(*self._pixels)) + away)
        variance = led_on(variance)
        sigma = self._at_pixels(self._bins.deviation(phase, variance))
        on = (self._at_pixels(good, cv2.INTER_NEAREST) > 0) & (z > 0) & (sigma < _FAR * z)
        on &= self._at_pixels(rim) > RIM
        sure = self._at_pixels(sure, cv2.INTER_NEAREST) > 0
        on &= sure | (self._at_pixels(share) > _SHARE)
        cloud, depth = self.cloud, z[on]
        cloud.points[on, :2], cloud.points[on, 2] = self._rays[on] * depth[:, None], depth
        cloud.intensity[on] = self._at_pixels(self._fit.amplitude)[on]
        cloud.sigma[on] = sigma[on]
        pixel = depth / np.float32(self._rig.camera.camera_matrix[0, 0])
        wavelength = self._at_pixels(at_bins(denoised.wavelength))[on]
        cloud.resolution[on] = wavelength * np.float32(self._grid.period) * pixel

    def _share(self, near, inner: NDArray[np.bool_], phase: NDArray[np.float32]):
        """Share of the surface's light, led on beyond it, which is there (eq. 11)."""
        grid = self._grid
        wave, _ = self._fit.waveform.at(phase)
        level, amplitude = map(Nearest(inner), (self._fit.level, self._fit.amplitude))
        nodes = grid.at_nodes((~near).astype(np.float32)) == 1
        if not nodes.any():
            return np.zeros(grid.shape, np.float32)
        beyond = grid.at_bins(Nearest(nodes)(grid.at_nodes(self._light)))
        surface = level + amplitude * wave - beyond
        here, all_of_it = (
            grid.smooth_bins(each, _RIM_WIDTH)
            for each in ((self._light - beyond) * surface, np.square(surface))
        )
        return here / np.maximum(all_of_it, 1)

    def _at_pixels(self, bins, how=cv2.INTER_LINEAR):
        """Values of the bins at the cloud's pixels."""
        grid, (columns, rows) = self._grid, self._pixels
        scale = np.array([[self._stride / grid.step, 0, 0], [0, self._stride / grid.rows, 0]])
        scale[:, 2] = 0.5 / grid.step - 0.5, 0.5 / grid.rows - 0.5  # of the first pixel
        return cv2.warpAffine(
            bins.astype(np.float32),
            scale,
            (len(columns), len(rows)),
            flags=how | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )


def within_panel(rig: Rig, pattern: Pattern, phase, v_p) -> NDArray[np.floating]:
    """Projector pixels from the panel's nearest rim, less than 0 beyond it."""
    u_p, panel = pattern.column(phase), rig.projector
    across = np.minimum(u_p, panel.width - 1 - u_p)
    return np.minimum(across, np.minimum(v_p, panel.height - 1 - v_p)) + 0.5
