"""One pose's photographs to its correspondences, or a sentence why they give none."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.sequence import ProjectedFrame, Sequence
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.robust import NORMAL_SPREAD, median

#: Photographs by what is projected in them, in the order of the sequence.
Photographs = Mapping[ProjectedFrame, NDArray[np.uint8]]
Part = tuple[slice, slice]

_WHOLE: Part = (slice(None), slice(None))
_WORDS = {'u': 'columns', 'v': 'rows'}


@dataclass(frozen=True, eq=False)
class Observation:
    """A board's corners in one pose, in the order of the board's points.

    Attributes
    ----------
    name : str
        Of the pose, for sentences.
    camera : ndarray, shape (n, 2)
        Camera pixels (u, v); NaN where a corner is not seen.
    projector : ndarray, shape (n, 2)
        Projector pixels (u, v) that light the corners; NaN where not known, one axis alone too.
    """

    name: str
    camera: NDArray[np.float64]
    projector: NDArray[np.float64]

    @property
    def has_projector(self) -> bool:
        """Whether the projector's coordinates of any corner are known."""
        return bool(np.isfinite(self.projector).any())


def _stack(
    photographs: Photographs, kind: str, axis: str, part: Part = _WHOLE
) -> NDArray[np.float32]:
    """Levels of the photographs of a kind and an axis in their order, shape (n, ...)."""
    chosen = [
        image[part]
        for frame, image in photographs.items()
        if (frame.kind, frame.axis) == (kind, axis)
    ]
    return np.array(chosen, np.float32)


def _lit_evenly(
    photographs: Photographs, sequence: Sequence, axis: str, part: Part = _WHOLE
) -> NDArray[np.float32]:
    """Photographs of an axis, taken or composed, that are lit alike if all are averaged.

    Shifts are such, whose fringes and second harmonics cancel over the period, and the sum of each
    Gray bit and its inverse.
    """
    if sequence.period:
        return _stack(photographs, 'shift', axis, part)
    bits, inverses = (_stack(photographs, kind, axis, part) for kind in ('gray', 'inverse'))
    return bits + inverses


def _moments(photographs: Photographs, sequence: Sequence) -> dict[str, NDArray[np.uint8]]:
    """Photographs in which the board is lit evenly, by when they were taken."""
    moments = {'the white one': photographs[ProjectedFrame('white')]}
    for axis, name in _WORDS.items():
        mean = _lit_evenly(photographs, sequence, axis).mean(axis=0)
        # Over the whole range of levels: rounding would cost sub-pixel accuracy.
        even = np.rint(mean * (254 / max(float(mean.max()), 1))).astype(np.uint8)
        moments[f'those of the {name}'] = even
    if sequence.period:
        moments['the last one'] = photographs[ProjectedFrame('white', '', 1)]
    return moments


def _decoded(
    photographs: Photographs, sequence: Sequence, axis: str, part: Part
) -> NDArray[np.float32]:
    """Projector pixels along an axis in a part of the photographs; NaN where unknown.

    Raises
    ------
    CalibrationError
        The codes are not of this projector.
    """
    white, black = (
        photographs[ProjectedFrame(kind)][part].astype(np.float32) for kind in ('white', 'black')
    )
    # A lit pixel is brighter by this than an unlit one: three times what rounding and read noise
    # do.
    known = white - black > 6.0
    bits, inverses = (_stack(photographs, kind, axis, part) for kind in ('gray', 'inverse'))
    between = (white + black) / 2 if sequence.period else inverses
    binary = np.logical_xor.accumulate(bits > between)
    word = np.tensordot(1 << np.arange(len(binary))[::-1], binary, axes=1)
    value = word.astype(np.float32)
    if sequence.period:
        phase, noise = _phase(_stack(photographs, 'shift', axis, part))
        turn = np.mod(phase / (2 * np.pi), 1)
        order = np.where(
            turn < 0.25, (word + 1) // 2, np.where(turn < 0.75, word // 2, (word - 1) // 2)
        )
        value = ((order + turn) * sequence.period).astype(np.float32)
        # Phases noisier than this could be of the next code word; radians.
        known &= noise <= 0.4
    size = sequence.size(axis)
    beyond = value > size - 0.5
    # Wrong bits in dark squares put fewer codes than this off the projector.
    if known.any() and float(np.mean(beyond[known])) > 0.05:
        raise CalibrationError(
            f'{_WORDS[axis]}: codes reach {np.percentile(value[known], 98):.0f}, and the '
            f'projector has {size} of them: give its width and height in this order, and the '
            'photographs in that of their projection'
        )
    value[~known | beyond | (value < -0.5)] = np.nan
    return value


def _phase(shifts: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Phase of the fringes in the steps of a period, shape (n, ...), and its deviation."""
    angle = 2 * np.pi * np.arange(len(shifts)) / len(shifts)
    basis = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    _, cosine, sine = np.tensordot(np.linalg.pinv(basis).astype(np.float32), shifts, axes=1)
    noise = np.sqrt(2 / len(shifts)) / np.maximum(np.hypot(cosine, sine), 1e-3)
    noise[(shifts > 254).any(axis=0)] = np.inf
    return np.arctan2(sine, cosine), noise


def corner_coordinates(
    code: NDArray[np.float32], corners: NDArray[np.float64], spacing: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Projector pixels along an axis at corners (n, 2), and how they scatter about the fit.

    Both have the shape (n,), and NaN where nothing is known. `code` are those of all pixels.

    About each corner a quadratic in the camera's pixels is fitted to the projector's coordinates
    (the local homographies of Moreno and Taubin, 3DIMPVT 2012, to second order), and read at the
    corner. White and black squares lie symmetrically about it, so that what blur does to the phase
    at their edges cancels.
    """
    # Up to this part of the way to the nearest corner: beyond it a quadratic no longer follows the
    # perspective of a tilted board.
    radius = max(3, int(0.9 * spacing))
    # More pixels than about this many along a window's side tell nothing more.
    step = max(1, round(2 * radius / 49))
    result, scatter = np.full((2, len(corners)), np.nan)
    for index in np.flatnonzero(np.isfinite(corners[:, 0])):
        column, row = np.rint(corners[index]).astype(int)
        first = np.maximum([column - radius, row - radius], 0)
        window = code[first[1] : row + radius + 1 : step, first[0] : column + radius + 1 : step]
        result[index], scatter[index] = _at(window, (corners[index] - first) / step, radius / step)
    return result, scatter


def _at(values: NDArray, centre: NDArray, radius: float) -> tuple[float, float]:
    """Value of a robust quadratic fit to a window, at a point of it, and the median residual."""
    rows, columns = np.nonzero(np.isfinite(values))
    x, y = (columns - centre[0]) / radius, (rows - centre[1]) / radius
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    value = values[rows, columns].astype(float)
    # A first guess that half of the pixels may spoil: about the median.
    off = np.abs(value - median(value))
    limit = 3 * median(off) + 1
    for _ in range(4):
        kept = off <= limit
        # Fewer pixels than this do not hold down the six coefficients.
        if kept.sum() < 40:
            return np.nan, np.nan
        coefficients, *_ = np.linalg.lstsq(basis[kept], value[kept], rcond=None)
        off = np.abs(basis @ coefficients - value)
        # A pixel this many robust deviations off the fit has a wrong code.
        limit = 4.0 * NORMAL_SPREAD * median(off[kept]) + 1e-3
    found = float(coefficients[0]) if np.mean(off <= limit) > 0.5 else np.nan
    return found, median(off)


@dataclass(frozen=True, eq=False)
class BoardSight:
    """A pose as it was seen.

    Attributes
    ----------
    observation : Observation
    blur_px : float
        Standard deviation of the edges' blur, camera pixels.
    moved_px : float
        Between photographs, at most.
    contrast : float
        Of the fringes' or codes' light on white squares, grey levels.
    remark : str
        What the pose lacks, though it can be used; empty if nothing.
    """

    observation: Observation
    blur_px: float
    moved_px: float
    contrast: float
    remark: str


def observe(name: str, photographs: Photographs, sequence: Sequence, board: Board) -> BoardSight:
    """Find the board's corners and their projector coordinates.

    Raises
    ------
    CalibrationError
        The pose cannot be used: not seen whole, blurred, saturated, moved, out of order.
    """
    even = _moments(photographs, sequence)
    found: dict[str, NDArray[np.float64]] = {}
    for moment, image in even.items():
        with suppress(CalibrationError):
            found[moment] = board.find(image)
    if not found:
        # Once more, to say why.
        board.find(next(iter(even.values())))
    moment, corners = next(iter(found.items()))
    spacing = board.spacing(corners)
    _, blur = board.refine(even[moment], corners)
    # Edges softer than this part of a square (standard deviation) blur one corner into the next.
    if not blur <= 0.12 * spacing:
        raise CalibrationError(
            f'blurred: edges are {blur:.1f} pixels soft, and a square is {spacing:.0f} pixels: '
            'focus the camera, or bring the board into its depth of field'
        )
    moved = 0.0
    for first, second in pairwise(found):
        shift = np.linalg.norm(found[first] - found[second], axis=1)
        moved = max(moved, median(shift[np.isfinite(shift)]))
        # Corners of a board that stands still agree to 0.03 pixels between photographs; a board
        # that moved by more than this is off by as much.
        if moved > 0.15:
            raise CalibrationError(
                f'the board moved by {moved:.1f} pixels between {first} and {second}: hold it '
                'still and take the pose again'
            )
    mean: NDArray = np.mean([even[key] / max(even[key].max(), 1) for key in found], axis=0)
    corners, _ = board.refine(255 * mean, np.mean(list(found.values()), axis=0))
    low = np.floor(np.nanmin(corners, axis=0) - 1.5 * spacing).astype(int).clip(0)
    high = np.ceil(np.nanmax(corners, axis=0) + 1.5 * spacing).astype(int) + 1
    part = slice(low[1], high[1]), slice(low[0], high[0])
    projected, scatter = np.full((2, *corners.shape), np.nan)
    for index, axis in enumerate(_WORDS):
        _refuse_light(_lit_evenly(photographs, sequence, axis, part), bool(sequence.period))
        code = np.full(mean.shape, np.nan, np.float32)
        code[part] = _decoded(photographs, sequence, axis, part)
        projected[:, index], scatter[:, index] = corner_coordinates(code, corners, spacing)
    _refuse_disorder(board, projected, scatter, sequence)
    seen = int(np.isfinite(corners[:, 0]).sum())
    lit = int(np.isfinite(projected).all(axis=1).sum())
    remark = f'{seen - lit} of {seen} corners have no projector coordinates' if lit < seen else ''
    stack = np.stack([image[part] for frame, image in photographs.items() if frame.axis])
    contrast = float(np.percentile(np.ptp(stack, axis=0), 75))
    return BoardSight(Observation(name, corners, projected), blur, moved, contrast, remark)


def _refuse_light(equal: NDArray[np.float32], fringes: bool) -> None:
    """Refuse light that changes between photographs (n, ...) lit alike, and clipped fringes."""
    means = equal.mean(axis=(1, 2))
    # Mean levels of photographs in equal light differ by this factor at most.
    if means.max() > 1.25 * means.min():
        raise CalibrationError(
            'the light changes from photograph to photograph: some are '
            f'{means.max() / means.min():.1f} times as bright as others that are meant alike: '
            'fix exposure and gain of the camera, and shut out other light'
        )
    brightest = equal.max(axis=0)
    clipped = float(np.mean(brightest[brightest >= np.median(brightest)] >= 254))
    if fringes and clipped > 0.5:
        raise CalibrationError(
            f'saturated: {100 * clipped:.0f} % of the white squares are clipped: shorten the '
            'exposure or close the aperture'
        )


def _refuse_disorder(
    board: Board, projected: NDArray, scatter: NDArray, sequence: Sequence
) -> None:
    """Refuse codes that do not run evenly over the plane of the board."""
    known = np.isfinite(projected).all(axis=1)
    if known.sum() < 8:
        raise CalibrationError(
            f'the projected codes are read at {known.sum()} corners, fewer than 8: light the '
            'whole board, and see that the photographs are in order'
        )
    # A lens bends a plane's image by less than this part of the projector's width.
    plane, inliers = cv2.findHomography(
        board.points[known, :2], projected[known], cv2.RANSAC, 0.03 * sequence.width
    )
    jumps = 1.0 if plane is None else 1 - float(np.mean(np.asarray(inliers)))
    # Codes of neighbouring pixels scatter by a third of a pixel (rounding); more is no plane.
    if jumps > 0.15 or median(scatter[np.isfinite(scatter)]) > 1.0:
        raise CalibrationError(
            'the codes do not run evenly over the board: photographs are out of order, the light '
            'changes between them, or the projector and the sequence have different sizes'
        )
