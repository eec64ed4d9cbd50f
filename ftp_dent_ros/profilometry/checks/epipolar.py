"""Whether the light lies on its epipolar lines: the rig, checked by each cloud.

The fringes say which projector column a pixel sees; the epipolar line says in which row. Along
coded fringes the contrast rises and falls with the row (`Pattern.row_contrast`), so that the
photograph says it too. Their difference is what is wrong with the rig, as far as it leads off
the epipolar lines: what moves the light along them (yaw, the baseline's length) looks like
another depth, and is seen only by what of it leads off them: a shift and a stretch of a tenth or
less.

A shift, a turn and a stretch are fitted to what blocks of the photograph show. How the blocks
scatter, with all that they see, is the uncertainty. Another pattern or rig is refused; what a
calibration may err by is for `ftp_dent_ros.profilometry.rig_alarm`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.checks.frame import ADVICE
from ftp_dent_ros.profilometry.checks.rows import PERIODS, Blocks, Rows, blocks_of
from ftp_dent_ros.profilometry.triangulation import triangulate
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.robust import FITS, redescending

#: Photographs of which one tells of a shift, a turn or a stretch that is not there, if what the
#: blocks leave is normal.
ONE_IN = 200_000
# Turns and stretches up to which the way is found.
_MOST = 0.1


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
    def figures(self) -> NDArray[np.float64]:
        """Shift, turn and stretch where they are seen, and deviations, pixels, shape (2, 3)."""
        lever = np.array([1.0, self.reach, self.height])
        deviations = self.shift_deviation, self.turn_deviation, self.stretch_deviation
        return lever * [[self.shift, self.turn, self.stretch], deviations]

    @property
    def sure(self) -> float:
        """Standard deviations from which on one of two sides of three figures is no chance."""
        return float(stdtrit(self.places - 3, 1 - 1 / ONE_IN / 6))

    @property
    def seen(self) -> bool:
        """Whether the rows are seen at all: without, nothing else here means anything."""
        return self.strength > self.sure * self.strength_deviation

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


def check_rows(pattern: Pattern, found: EpipolarCheck) -> None:
    """Raise the reason if the rows of the projector cannot be those of the given pattern.

    Raises
    ------
    OtherPatternError
        Surely, the contrast does not change half as much along the fringes as it must; or it
        does, but in another scale, or beside the epipolar lines, by more than a fringe.
    """
    if 2 * (found.strength + found.sure * found.strength_deviation) < 1:
        raise OtherPatternError(
            f'along the fringes the contrast does not change every {pattern.row_period_px:g} px '
            f'as the given pattern has it (row_depth, row_period_px): {ADVICE}'
        )
    values, deviations = found.figures
    far = found.seen & (np.abs(values) > pattern.period_px + found.sure * deviations)
    if far[2]:
        raise OtherPatternError(
            f'the rows of the projector are {1 + found.stretch:.3f} times as far apart as rig and '
            f'pattern have them: {ADVICE}, and let the projector show images of its own '
            'resolution'
        )
    if far.any():
        raise OtherPatternError(
            f'the light lies {np.abs(values).max():.0f} px beside its epipolar lines: {ADVICE}'
        )


def check_epipolar(rig: Rig, pattern: Pattern, rows: Rows, window: float) -> EpipolarCheck | None:
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
    if not pattern.tells_rows:
        return None
    blocks = blocks_of(pattern, rows)
    if len(blocks.u) < 2 * 3:
        return None
    turn = 2 * math.pi / pattern.row_period_px
    middle = [float(np.average(each, weights=blocks.weight)) for each in (blocks.u, blocks.v)]
    terms = np.stack([np.ones_like(blocks.u), blocks.u - middle[0], blocks.v - middle[1]], axis=1)
    reach, height = np.sqrt(np.average(np.square(terms[:, 1:]), axis=0, weights=blocks.weight))
    if 2 * min(reach, height) < PERIODS * pattern.row_period_px:
        return None
    found = _nearest(terms, blocks, turn)
    weight = blocks.weight
    for _ in range(FITS):
        away = blocks.wave * np.exp(-1j * turn * (terms @ found))
        amplitude = abs(np.average(away, weights=weight))
        beside = away.imag / (amplitude * turn)
        inverse = np.linalg.inv(terms.T @ (weight[:, None] * terms))
        step = inverse @ (terms.T @ (weight * beside))
        found = found + step
        rest = beside - terms @ step
        used, weight = weight, blocks.weight * redescending(rest)
    noise = np.square(used * away.imag).sum() / used.sum() ** 2
    given = _given_amplitude(pattern, window)
    deviation = np.sqrt(np.diag(_covariance(terms, rest, used, inverse, blocks.place)))
    at_axis = found[0] - found[1] * (middle[0] - rig.projector.camera_matrix[0, 2])
    depth_error, blind = _depth_errors(rig, blocks, float(at_axis), found[1])
    return EpipolarCheck(
        shift=float(found[0]),
        shift_deviation=float(deviation[0]),
        turn=float(found[1]),
        turn_deviation=float(deviation[1]),
        stretch=float(found[2]),
        stretch_deviation=float(deviation[2]),
        reach=float(reach),
        height=float(height),
        places=len(blocks.u),
        strength=float(amplitude / given),
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

    turns, stretches = (steps(places, _MOST) for places in terms.T[1:])
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
