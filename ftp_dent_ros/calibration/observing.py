"""One pose's photographs to its correspondences, or a sentence why they give none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.sequence import ProjectedFrame, Sequence
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.robust import NORMAL_SPREAD

# A lit pixel is brighter by this than an unlit one: three times what rounding and read noise do.
_LEAST_CONTRAST = 6.0

Photographs = Mapping[ProjectedFrame, NDArray[np.uint8]]

# A window reaches this part of the way to the nearest corner. Beyond it a quadratic no longer
# follows the perspective of a tilted board.
_REACH = 0.9
# Fewer pixels than this do not hold down the six coefficients.
_FEWEST = 40

# A pair of bit and inverse adds up to white and black, to this part of their contrast.
_PAIR = 0.25


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


@dataclass(frozen=True, eq=False)
class Codes:
    """Projector pixels seen by camera pixels.

    Attributes
    ----------
    u, v : ndarray, shape (height, width), float32
        NaN where unknown.
    troubles : tuple of str
        What could not be decoded, and why.
    """

    u: NDArray[np.float32]
    v: NDArray[np.float32]
    troubles: tuple[str, ...] = ()


def decode(photographs: Photographs, sequence: Sequence, part: tuple[slice, slice]) -> Codes:
    """Decode one pose.

    Parameters
    ----------
    photographs : mapping of ProjectedFrame to ndarray, shape (height, width), uint8
        Grey photographs; some may be missing.
    sequence : Sequence
    part : (slice, slice)
        Rows and columns to decode; the rest is NaN.

    Returns
    -------
    Codes
        An axis that cannot be decoded is all NaN, with a trouble that says why.
    """
    shape = next(iter(photographs.values())).shape
    axes: list[NDArray[np.float32]] = []
    troubles: list[str] = []
    for axis in 'uv':
        whole = np.full(shape, np.nan, np.float32)
        try:
            whole[part] = _decode_axis(photographs, sequence, axis, part)
        except CalibrationError as error:
            troubles.append(str(error))
        axes.append(whole)
    return Codes(axes[0], axes[1], tuple(troubles))


def lit_evenly(photographs: Photographs, steps: int) -> dict[str, NDArray[np.uint8]]:
    """Photographs, taken or composed, in which the board is lit evenly, by when they were taken.

    The sum of a bit and its inverse are such, and the mean of shifts, of `steps` a period, whose
    fringes and second harmonics cancel: that of a whole period or of every other step of it.
    """
    found: dict[str, NDArray[np.uint8]] = {}
    if ProjectedFrame('white') in photographs:
        found['the white one'] = photographs[ProjectedFrame('white')]
    for axis, word in (('u', 'columns'), ('v', 'rows')):
        shifts = {
            frame.index: image
            for frame, image in photographs.items()
            if frame.kind == 'shift' and frame.axis == axis
        }
        turns = np.exp(2j * np.pi * np.array(list(shifts)) / steps)
        cancel = max(abs(turns.sum()), abs((turns * turns).sum())) < 1e-6
        pairs = [
            (image, photographs[ProjectedFrame('inverse', axis, frame.index)])
            for frame, image in photographs.items()
            if frame.kind == 'gray'
            and frame.axis == axis
            and ProjectedFrame('inverse', axis, frame.index) in photographs
        ]
        if len(shifts) > 2 and cancel:
            mean = np.mean(np.stack(list(shifts.values())), axis=0, dtype=np.float32)
            found[f'those of the {word}'] = _stretched(mean)
        elif pairs:
            mean = np.mean(
                np.concatenate([np.stack(pair) for pair in pairs]), axis=0, dtype=np.float32
            )
            found[f'those of the {word}'] = _stretched(mean)
    if ProjectedFrame('white', '', 1) in photographs:
        found['the last one'] = photographs[ProjectedFrame('white', '', 1)]
    return found


def _stretched(mean: Any) -> NDArray[np.uint8]:
    """Grey levels over their whole range: rounding would cost sub-pixel accuracy."""
    return np.clip(np.rint(mean * (254 / max(float(mean.max()), 1))), 0, 255).astype(np.uint8)


def _decode_axis(
    photographs: Photographs, sequence: Sequence, axis: str, part: tuple[slice, slice]
) -> NDArray[np.float32]:
    shifts = {
        frame.index: photographs[frame][part].astype(np.float32)
        for frame in sequence.frames
        if frame.kind == 'shift' and frame.axis == axis and frame in photographs
    }
    word, lost, lit = _words(photographs, sequence, axis, part, shifts)
    if not sequence.period:
        coarse = 1 << lost
        value = word.astype(np.float32) * coarse + (coarse - 1) / 2
        return _on_projector(value, lit, sequence, axis)
    if lost > 0:
        raise CalibrationError(f'{_word(axis)}: the finest Gray bit is missing')
    if len(shifts) < 3:
        raise CalibrationError(
            f'{_word(axis)}: {len(shifts)} of {sequence.steps} shifted photographs are there, '
            'fewer than 3'
        )
    phase, noise, _ = _phase(shifts, sequence.steps)
    turn = np.mod(phase / (2 * np.pi), 1)
    order = np.where(
        turn < 0.25, (word + 1) // 2, np.where(turn < 0.75, word // 2, (word - 1) // 2)
    )
    value = ((order + turn) * sequence.period).astype(np.float32)
    # Phases noisier than this could be of the next code word; radians.
    return _on_projector(value, lit & (noise <= 0.4), sequence, axis)


def _on_projector(
    value: NDArray[np.float32], known: NDArray[np.bool_], sequence: Sequence, axis: str
) -> NDArray[np.float32]:
    """Values without those that are not known or off the projector, of which there are few."""
    size = sequence.size(axis)
    beyond = value > size - 0.5
    # Wrong bits in dark squares put fewer codes than this off the projector.
    if np.any(known) and float(np.mean(beyond[known])) > 0.05:
        raise CalibrationError(
            f'{_word(axis)}: codes reach {np.percentile(value[known], 98):.0f}, and the projector '
            f'has {size} of them: give its width and height in this order, and the photographs '
            'in that of their projection'
        )
    value[~known | beyond | (value < -0.5)] = np.nan
    return value


def _words(
    photographs: Photographs,
    sequence: Sequence,
    axis: str,
    part: tuple[slice, slice],
    shifts: Mapping[int, NDArray[np.float32]],
) -> tuple[NDArray[np.int32], int, NDArray[np.bool_]]:
    """Gray code words, how many of their finest bits are missing, and where they can be read."""
    white, black = (photographs.get(ProjectedFrame(kind)) for kind in ('white', 'black'))
    middle: NDArray | None = None
    if white is not None and black is not None:
        middle = (white[part].astype(np.float32) + black[part]) / 2
    elif len(shifts) > 2:
        _, _, middle = _phase(shifts, sequence.steps)
    bits: list[NDArray[np.bool_] | None] = []
    contrast: list[NDArray[np.float32]] = []
    for index in range(sequence.bits(axis)):
        bit = photographs.get(ProjectedFrame('gray', axis, index))
        inverse = photographs.get(ProjectedFrame('inverse', axis, index))
        if bit is not None and inverse is not None:
            difference = bit[part].astype(np.float32) - inverse[part]
            contrast.append(np.abs(difference))
        elif middle is not None and (bit is not None or inverse is not None):
            there, sign = (bit, 2) if bit is not None else (inverse, -2)
            difference = sign * (np.asarray(there)[part] - middle)
            contrast.append(np.abs(difference))
        else:
            bits.append(None)
            continue
        bits.append(difference > 0)
    known = [bit is not None for bit in bits]
    lost = known[::-1].index(True) if any(known) else len(known)
    if not all(known[: len(known) - lost]) or lost > 3:
        missing = [index for index, there in enumerate(known) if not there]
        raise CalibrationError(
            f'{_word(axis)}: the photographs of {len(missing)} of {len(known)} Gray bits are '
            f'missing (bit {", ".join(map(str, missing))})'
        )
    if white is not None and black is not None:
        lit = white[part].astype(np.float32) - black[part] > _LEAST_CONTRAST
    else:
        lit = np.max(contrast, axis=0) > _LEAST_CONTRAST
    word = np.zeros(lit.shape, np.int32)
    last = np.zeros(lit.shape, bool)
    for each in bits[: len(bits) - lost]:
        last = last ^ each
        word = 2 * word + last
    return word, lost, lit


def _phase(
    shifts: Mapping[int, NDArray[np.float32]], steps: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Phase by least squares over the steps there are, its standard deviation, and the mean."""
    angle = 2 * np.pi * np.array(list(shifts)) / steps
    basis = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    inverse = np.linalg.pinv(basis).astype(np.float32)
    stack = np.stack(list(shifts.values()))
    mean, cosine, sine = np.tensordot(inverse, stack, axes=(1, 0))
    modulation = np.maximum(np.hypot(cosine, sine), 1e-3)
    clipped = (stack > 254).any(axis=0)
    noise = np.sqrt(2 / len(stack)) / modulation
    noise[clipped] = np.inf
    return np.arctan2(sine, cosine), noise, mean


def _word(axis: str) -> str:
    return 'columns' if axis == 'u' else 'rows'


def corner_coordinates(
    codes: Codes, corners: NDArray[np.float64], spacing: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Projector pixels (u, v) at corners of shape (n, 2), and how they scatter about the fit.

    Both have the corners' shape, and NaN where nothing is known.

    About each corner a quadratic in the camera's pixels is fitted to the projector's coordinates
    (the local homographies of Moreno and Taubin, 3DIMPVT 2012, to second order), and read at the
    corner. White and black squares lie symmetrically about it, so that what blur does to the phase
    at their edges cancels.
    """
    radius = max(3, int(_REACH * spacing))
    # More pixels than about this many along a window's side tell nothing more.
    step = max(1, round(2 * radius / 49))
    result, scatter = np.full((2, *corners.shape), np.nan)
    for index, corner in enumerate(corners):
        if not np.isfinite(corner).all():
            continue
        column, row = np.rint(corner).astype(int)
        rows = slice(max(row - radius, 0), row + radius + 1, step)
        columns = slice(max(column - radius, 0), column + radius + 1, step)
        for axis, values in enumerate((codes.u, codes.v)):
            centre = (corner - [columns.start, rows.start]) / step
            result[index, axis], scatter[index, axis] = _at(
                values[rows, columns], centre, radius / step
            )
    return result, scatter


def _at(values: NDArray, centre: NDArray, radius: float) -> tuple[float, float]:
    """Value of a robust quadratic fit to a window, at a point of it, and the median residual."""
    rows, columns = np.nonzero(np.isfinite(values))
    if len(rows) < _FEWEST:
        return np.nan, np.nan
    x, y = (columns - centre[0]) / radius, (rows - centre[1]) / radius
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    value = values[rows, columns].astype(float)
    # A first guess that half of the pixels may spoil: about the median.
    kept = np.abs(value - np.median(value)) <= 3 * np.median(np.abs(value - np.median(value))) + 1
    coefficients, off = np.zeros(6), np.full(len(value), np.inf)
    for _ in range(4):
        if kept.sum() < _FEWEST:
            return np.nan, np.nan
        coefficients, *_ = np.linalg.lstsq(basis[kept], value[kept], rcond=None)
        off = np.abs(basis @ coefficients - value)
        # A pixel this many robust deviations off the fit has a wrong code.
        kept = off <= 4.0 * NORMAL_SPREAD * np.median(off[kept]) + 1e-3
    scatter = float(np.median(off))
    return (float(coefficients[0]) if kept.mean() > 0.5 else np.nan), scatter


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
    remarks : tuple of str
        What the pose lacks, though it can be used.
    """

    observation: Observation
    blur_px: float
    moved_px: float
    contrast: float
    remarks: tuple[str, ...]


def observe(name: str, photographs: Photographs, sequence: Sequence, board: Board) -> BoardSight:
    """Find the board's corners and their projector coordinates.

    Raises
    ------
    CalibrationError
        The pose cannot be used: not seen whole, blurred, saturated, moved, out of order.
    """
    try:
        return _observe(name, photographs, sequence, board)
    except CalibrationError as reason:
        raise CalibrationError(f'{name}: {reason}') from None


def _observe(name: str, photographs: Photographs, sequence: Sequence, board: Board) -> BoardSight:
    if not photographs:
        raise CalibrationError('holds no photographs: take the pose again')
    even = lit_evenly(photographs, sequence.steps)
    if not even:
        raise CalibrationError(
            'no photograph shows the board lit evenly: the white one is missing'
        )
    found = {
        moment: corners
        for moment, image in even.items()
        if (corners := _found(board, image)) is not None
    }
    if not found:
        board.find(next(iter(even.values())))  # raises the reason
    moment, corners = next(iter(found.items()))
    spacing = board.spacing(corners)
    _, blur = board.refine(even[moment], corners)
    # Edges softer than this part of a square (standard deviation) blur one corner into the next.
    if not blur <= 0.12 * spacing:
        raise CalibrationError(
            f'blurred: edges are {blur:.1f} pixels soft, and a square is {spacing:.0f} pixels: '
            'focus the camera, or bring the board into its depth of field'
        )
    moved, between = _movement(found)
    # Corners of a board that stands still agree to 0.03 pixels between photographs; a board that
    # moved by more than this is off by as much.
    if moved > 0.15:
        raise CalibrationError(
            f'the board moved by {moved:.1f} pixels between {between[0]} and {between[1]}: hold '
            'it still and take the pose again'
        )
    mean: NDArray = np.mean([even[key] / max(even[key].max(), 1) for key in found], axis=0)
    corners, _ = board.refine(255 * mean, np.mean(list(found.values()), axis=0))
    part = _around(corners, spacing, mean.shape)
    _refuse_clipped(photographs, part)
    _refuse_changing_light(photographs, part)
    _refuse_disorder(photographs, part)
    codes = decode(photographs, sequence, part)
    projected, scatter = corner_coordinates(codes, corners, spacing)
    _refuse_jumps(board, projected, scatter, sequence, codes.troubles)
    remarks = list(codes.troubles)
    seen = np.isfinite(corners[:, 0]).sum()
    lit = np.isfinite(projected).all(axis=1).sum()
    if lit < seen and not codes.troubles:
        remarks.append(f'{seen - lit} of {seen} corners have no projector coordinates')
    observation = Observation(name, corners, projected)
    return BoardSight(observation, blur, moved, _contrast(photographs, part), tuple(remarks))


def _found(board: Board, image: NDArray[np.uint8]) -> NDArray[np.float64] | None:
    try:
        return board.find(image)
    except CalibrationError:
        return None


def _movement(found: dict[str, NDArray]) -> tuple[float, tuple[str, str]]:
    """Largest median shift of the corners between two moments, pixels, and the moments."""
    largest, between = 0.0, ('', '')
    moments = list(found)
    for first, second in pairwise(moments):
        shift = np.linalg.norm(found[first] - found[second], axis=1)
        if np.isfinite(shift).any() and np.nanmedian(shift) > largest:
            largest, between = float(np.nanmedian(shift)), (first, second)
    return largest, between


def _around(corners: NDArray, spacing: float, shape: tuple[int, ...]) -> tuple[slice, slice]:
    low = np.floor(np.nanmin(corners, axis=0) - 1.5 * spacing).astype(int).clip(0)
    high = np.ceil(np.nanmax(corners, axis=0) + 1.5 * spacing).astype(int) + 1
    return slice(low[1], min(high[1], shape[0])), slice(low[0], min(high[0], shape[1]))


def _refuse_clipped(photographs: Photographs, part: tuple[slice, slice]) -> None:
    shifts = [image[part] for frame, image in photographs.items() if frame.kind == 'shift']
    if not shifts:
        return
    brightest = np.max(shifts, axis=0)
    lit = brightest >= np.median(brightest)
    clipped = float((brightest[lit] >= 254).mean()) if lit.any() else 0.0
    if clipped > 0.5:
        raise CalibrationError(
            f'saturated: {100 * clipped:.0f} % of the white squares are clipped: shorten the '
            'exposure or close the aperture'
        )


def _refuse_changing_light(photographs: Photographs, part: tuple[slice, slice]) -> None:
    """Refuse shifted fringes, of which a board shows many, that are not equally bright on it."""
    for axis in 'uv':
        means = [
            float(image[part].mean())
            for frame, image in photographs.items()
            if (frame.kind, frame.axis) == ('shift', axis)
        ]
        if means and max(means) > 1.25 * min(means):
            raise CalibrationError(
                'the light changes from photograph to photograph: shifted fringes have mean '
                f'levels from {min(means):.0f} to {max(means):.0f}: fix exposure and gain of the '
                'camera, and shut out other light'
            )


def _refuse_disorder(photographs: Photographs, part: tuple[slice, slice]) -> None:
    """Refuse pairs of a bit and its inverse that do not add up to white and black."""
    white, black = (
        photographs.get(ProjectedFrame('white')),
        photographs.get(ProjectedFrame('black')),
    )
    if white is None or black is None:
        return
    total = white[part].astype(float) + black[part]
    contrast = np.maximum(white[part].astype(float) - black[part], 1)
    lit = contrast >= np.median(contrast)
    for frame, image in photographs.items():
        inverse = photographs.get(ProjectedFrame('inverse', frame.axis, frame.index))
        if frame.kind != 'gray' or inverse is None:
            continue
        pair = image[part].astype(float) + inverse[part]
        if np.median((np.abs(pair - total) / contrast)[lit]) <= _PAIR:
            continue
        # Other light makes the whole board brighter or darker, another order parts of it.
        light = float(np.median((pair / np.maximum(total, 1))[lit]))
        left = np.abs(pair - light * total) / (light * contrast + 1e-9)
        if np.percentile(left[lit], 90) <= _PAIR:
            raise CalibrationError(
                f'the light changes from photograph to photograph ({frame.name} and its inverse '
                f'are {light:.2f} times as bright as white and black): fix exposure and gain of '
                'the camera, and shut out other light'
            )
        raise CalibrationError(
            f'the photographs are out of order: {frame.name} and the one after it are no bit and '
            'its inverse: number them in the order in which they were projected'
        )


def _refuse_jumps(
    board: Board,
    projected: NDArray,
    scatter: NDArray,
    sequence: Sequence,
    troubles: tuple[str, ...],
) -> None:
    known = np.isfinite(projected).all(axis=1)
    # Codes of neighbouring pixels scatter by a third of a pixel (rounding); more is no plane.
    if np.isfinite(scatter).any() and np.nanmedian(scatter) > 1.0:
        raise CalibrationError(
            'the codes do not run evenly over the board: photographs are out of order, the light '
            'changes between them, or the projector and the sequence have different sizes'
        )
    if known.sum() < 8:
        if not troubles:
            raise CalibrationError(
                f'the projected codes are read at {known.sum()} corners, fewer than 8: light the '
                'whole board, and see that the photographs are in order'
            )
        return
    # A lens bends a plane's image by less than this part of the projector's width.
    plane, inliers = cv2.findHomography(
        board.points[known, :2], projected[known], cv2.RANSAC, 0.03 * sequence.width
    )
    share = 1.0 if plane is None else 1 - float(np.mean(np.asarray(inliers)))
    if share > 0.15:
        raise CalibrationError(
            f'the codes jump: at {100 * share:.0f} % of the corners they do not lie on a plane: '
            'photographs are out of order'
        )


def _contrast(photographs: Photographs, part: tuple[slice, slice]) -> float:
    stack = np.stack([image[part] for frame, image in photographs.items() if frame.axis])
    span = stack.max(axis=0).astype(float) - stack.min(axis=0)
    return float(np.percentile(span, 75))
