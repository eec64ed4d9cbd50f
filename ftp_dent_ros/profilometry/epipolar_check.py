"""Whether the light lies on its epipolar lines: the rig, checked by each cloud.

The fringes say which projector column a pixel sees; the epipolar line says in which row. Along
coded fringes the contrast rises and falls with the row (`Pattern.row_contrast`), so that the
photograph says it too. Their difference is what is wrong with the rig, as far as it leads off
the epipolar lines: what moves the light along them (yaw, the baseline's length) looks like
another depth, and is seen only by what of it leads off them: a shift and a stretch of a tenth or
less.

A shift, a turn and a stretch are fitted to what blocks of the photograph show. How the blocks
scatter, with all that they see, is the uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.projector_rows import Blocks, Rows, blocks_of
from ftp_dent_ros.profilometry.triangulation import triangulate
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.robust import NORMAL_SPREAD

# What is searched before the fit: turns and stretches up to so much.
_MOST_TURN, _MOST_STRETCH = 0.06, 0.12
# Standard deviation of the blocks' places along u and v from which on turn and stretch are known.
_LEAST_REACH = 60.0
# Fits, each without the blocks that the last one found off by so many standard deviations.
_FITS, _MOST_OFF = 6, 4.0
# Projector pixels by which the last fit may change the shift.
_SETTLED = 1e-4
# Signal over scatter below which the rows are not seen, and an amplitude to divide by then.
_SEEN, _FAINTEST = 6.0, 1e-4


@dataclass(frozen=True)
class EpipolarCheck:
    """Where the light lies beside its epipolar lines.

    Attributes
    ----------
    shift, shift_deviation : float
        Along v in the middle of what is seen, and its standard uncertainty, projector pixels.
    turn, turn_deviation : float
        Its slope along u, radians: a roll of the projector.
    stretch, stretch_deviation : float
        Its slope along v.
    reach, height : float
        Standard deviations along u and v of the places that it was seen at, projector pixels.
    places : int
        Blocks of the panel.
    strength, strength_deviation : float
        Depth of the contrast's waves along v over that of the given pattern.
    depth_error : float
        What a pitch and roll as they seem do to the cloud, root mean square, metres.
    blind_depth_error : float
        What a yaw as large would do beside it, which is hardly seen, metres.
    """

    shift: float
    shift_deviation: float
    turn: float
    turn_deviation: float
    stretch: float
    stretch_deviation: float
    reach: float
    height: float
    places: int
    strength: float
    strength_deviation: float
    depth_error: float
    blind_depth_error: float

    @property
    def seen(self) -> bool:
        """Whether the rows are seen at all: without, nothing else here means anything."""
        return self.strength > _SEEN * self.strength_deviation

    @property
    def sentence(self) -> str:
        """For people."""
        degrees = math.degrees(self.turn), math.degrees(self.turn_deviation)
        return (
            f'light {self.shift:+.2f} px ({self.shift_deviation:.2f}) beside its epipolar lines, '
            f'turned by {degrees[0]:+.4f} degrees ({degrees[1]:.4f}), stretched by '
            f'{100 * self.stretch:+.3f} % ({100 * self.stretch_deviation:.3f}): {self.effect}'
        )

    @property
    def effect(self) -> str:
        """What it does to the cloud."""
        return (
            f'the cloud is off by {1e3 * self.depth_error:.2f} mm for it, and by '
            f'{1e3 * self.blind_depth_error:.2f} mm more if the projector has turned as much '
            'along these lines, which they hardly show'
        )


def check_epipolar(
    rig: Rig, pattern: Pattern, surfaces: Sequence[Rows], window: float
) -> EpipolarCheck | None:
    """Check a rig by the rows of the projector that its surfaces show.

    Parameters
    ----------
    window : float
        Standard deviation of the windows that the contrast was measured in, projector pixels.

    Returns
    -------
    EpipolarCheck or None
        None where the pattern does not tell its rows, or too little of it is seen.
    """
    if not pattern.tells_rows or not surfaces:
        return None
    blocks = blocks_of(pattern, surfaces)
    if blocks is None:
        return None
    turn = 2 * math.pi / pattern.row_period_px
    middle = [float(np.average(each, weights=blocks.weight)) for each in (blocks.u, blocks.v)]
    terms = np.stack([np.ones_like(blocks.u), blocks.u - middle[0], blocks.v - middle[1]], axis=1)
    reach, height = (
        math.sqrt(float(np.average(np.square(each), weights=blocks.weight)))
        for each in terms.T[1:]
    )
    if reach < _LEAST_REACH or height < _LEAST_REACH:
        return None
    found = _nearest(terms, blocks, turn)
    trusted = np.ones_like(blocks.u)
    for _ in range(_FITS):
        weight = blocks.weight * trusted
        away = blocks.wave * np.exp(-1j * turn * (terms @ found))
        amplitude = max(float(np.average(away.real, weights=weight)), _FAINTEST)
        beside = away.imag / (amplitude * turn)
        inverse = np.linalg.inv(terms.T @ (weight[:, None] * terms))
        step = inverse @ (terms.T @ (weight * beside))
        found = found + step
        rest = beside - terms @ step
        held = np.abs(rest) <= _MOST_OFF * NORMAL_SPREAD * np.median(np.abs(rest))
        if (held == trusted).all() and np.abs(step[0]) < _SETTLED:
            break
        trusted = held.astype(float)
    noise = np.square(weight * away.imag).sum() / weight.sum() ** 2
    given = _given_amplitude(pattern, window)
    deviation = np.sqrt(np.diag(_covariance(terms, rest, weight, inverse, blocks.place)))
    at_axis = found[0] - found[1] * (middle[0] - rig.projector.camera_matrix[0, 2])
    shift, turned, stretch = (float(each) for each in found)
    deviations = [float(each) for each in deviation]
    depth_error, blind = _depth_errors(rig, blocks, float(at_axis), turned)
    return EpipolarCheck(
        shift=shift,
        shift_deviation=deviations[0],
        turn=turned,
        turn_deviation=deviations[1],
        stretch=stretch,
        stretch_deviation=deviations[2],
        reach=reach,
        height=height,
        places=int(np.count_nonzero(weight)),
        strength=amplitude / given,
        strength_deviation=math.sqrt(noise) / given,
        depth_error=depth_error,
        blind_depth_error=blind,
    )


def _given_amplitude(pattern: Pattern, window: float) -> float:
    """Amplitude of the logarithm of the contrast along v, as far as the windows leave it."""
    half = pattern.row_depth / 2
    angle = 2 * math.pi * window / pattern.row_period_px
    return half / (1 - half) * math.exp(-angle * angle / 2)


def _nearest(terms: NDArray, blocks: Blocks, turn: float) -> NDArray[np.float64]:
    """Shift, turn and stretch, roughly, with which the blocks agree best."""

    def steps(places: NDArray, most: float) -> NDArray[np.floating]:
        # A quarter of a turn at the farthest place.
        step = math.pi / 2 / turn / max(float(np.abs(places).max()), 1.0)
        count = math.floor(most / step)
        return step * np.arange(-count, count + 1)

    turns, stretches = steps(terms[:, 1], _MOST_TURN), steps(terms[:, 2], _MOST_STRETCH)
    tried = np.stack([each.ravel() for each in np.meshgrid([0.0], turns, stretches)], axis=1)
    sums = np.exp(-1j * turn * (tried @ terms.T)) @ (blocks.weight * blocks.wave)
    best = int(np.abs(sums).argmax())
    shift = float(np.angle(sums[best])) / turn
    return np.array([shift, *tried[best, 1:]], float)


def _covariance(
    terms: NDArray, rest: NDArray, weight: NDArray, inverse: NDArray, place: NDArray
) -> NDArray[np.float64]:
    """Covariance of weighted least squares by how the values scatter, whatever each one's own is.

    MacKinnon and White's HC3: residuals over one less their leverage. What is on one edge of
    the skin errs alike: where the sums over rows or over columns of blocks scatter more than
    independent blocks would, it is they that count.
    """
    leverage = weight * ((terms @ inverse) * terms).sum(axis=1)
    scores = terms * (weight * rest / np.maximum(1 - leverage, 0.1))[:, None]
    covariances = [inverse @ (scores.T @ scores) @ inverse]
    for line in place.T:
        sums = np.zeros((int(line.max()) + 1, terms.shape[1]))
        np.add.at(sums, line, scores)
        covariances.append(inverse @ (sums.T @ sums) @ inverse)
    return max(covariances, key=lambda each: float(each[0, 0]))


def _depth_errors(rig: Rig, blocks: Blocks, shift: float, turn: float) -> tuple[float, float]:
    """Errors of the depth by the pitch and roll that shift the light so, and by such a yaw."""
    (f_x, _, _), (_, f_y, _), _ = rig.projector.camera_matrix
    pitch, roll = -shift / f_y, turn * f_x / f_y
    rays = np.concatenate([blocks.rays, np.ones((len(blocks.rays), 1))], axis=1)

    def depth(*angles: float) -> NDArray[np.float32]:
        by, _ = cv2.Rodrigues(np.array(angles))
        true = Rig(rig.camera, rig.projector, by @ rig.rotation, by @ rig.translation)
        columns = blocks.u[None].astype(np.float32)
        return triangulate(true, rays[None].astype(np.float32), columns)[0]

    given = depth(0.0, 0.0, 0.0)
    errors = (given - depth(pitch, 0.0, roll), given - depth(0.0, math.hypot(pitch, roll), 0.0))
    met = np.isfinite(errors[0]) & np.isfinite(errors[1])
    if not met.any():
        return math.nan, math.nan
    seen, blind = (float(np.sqrt(np.mean(np.square(error[met])))) for error in errors)
    return seen, blind
