"""One pose's photographs to its correspondences, or a sentence why they give none."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.boards.board import Board
from ftp_dent_ros.calibration.observing.correspondences import corner_coordinates
from ftp_dent_ros.calibration.observing.decoding import Photographs, decode, lit_evenly
from ftp_dent_ros.calibration.observing.observation import Observation
from ftp_dent_ros.calibration.observing.sequence import Frame, Sequence
from ftp_dent_ros.errors import CalibrationError

# Corners of a board that stands still agree to 0.03 pixels between photographs; a board that
# moved by more than this is off by as much.
_MOVED_PX = 0.15
# Edges softer than this part of a square (standard deviation) blur one corner into the next.
_BLURRED = 0.12
_CLIPPED_SHARE = 0.5
_CLIPPED = 254
# Codes of neighbouring pixels scatter by a third of a pixel (rounding); more is no plane.
_SCATTER_PX = 1.0
# A lens bends a plane's image by less than this part of the projector's width.
_BENT = 0.03
_BEND_SHARE = 0.15
# A pair of bit and inverse adds up to white and black, to this part of their contrast.
_PAIR = 0.25


@dataclass(frozen=True, eq=False)
class Sight:
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


def observe(name: str, photographs: Photographs, sequence: Sequence, board: Board) -> Sight:
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


def _observe(name: str, photographs: Photographs, sequence: Sequence, board: Board) -> Sight:
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
    if not blur <= _BLURRED * spacing:
        raise CalibrationError(
            f'blurred: edges are {blur:.1f} pixels soft, and a square is {spacing:.0f} pixels: '
            'focus the camera, or bring the board into its depth of field'
        )
    moved, between = _movement(found)
    if moved > _MOVED_PX:
        raise CalibrationError(
            f'the board moved by {moved:.1f} pixels between {between[0]} and {between[1]}: hold '
            'it still and take the pose again'
        )
    mean: NDArray = np.mean([even[key] / max(even[key].max(), 1) for key in found], axis=0)
    corners, _ = board.refine(255 * mean, np.mean(list(found.values()), axis=0))
    part = _around(corners, spacing, mean.shape)
    _refuse_clipped(photographs, part)
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
    return Sight(observation, blur, moved, _contrast(photographs, part), tuple(remarks))


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
    clipped = float((brightest[lit] >= _CLIPPED).mean()) if lit.any() else 0.0
    if clipped > _CLIPPED_SHARE:
        raise CalibrationError(
            f'saturated: {100 * clipped:.0f} % of the white squares are clipped: shorten the '
            'exposure or close the aperture'
        )


def _refuse_disorder(photographs: Photographs, part: tuple[slice, slice]) -> None:
    white, black = photographs.get(Frame('white')), photographs.get(Frame('black'))
    if white is None or black is None:
        return
    total = white[part].astype(float) + black[part]
    contrast = np.maximum(white[part].astype(float) - black[part], 1)
    lit = contrast >= np.median(contrast)
    wrong = [
        frame.name
        for frame, image in photographs.items()
        if frame.kind == 'gray'
        and (inverse := photographs.get(Frame('inverse', frame.axis, frame.index))) is not None
        and float(
            np.median(
                np.abs(image[part].astype(float) + inverse[part] - total)[lit] / contrast[lit]
            )
        )
        > _PAIR
    ]
    if wrong:
        raise CalibrationError(
            f'the photographs are out of order: {wrong[0]} and the one after it are no bit and '
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
    if np.isfinite(scatter).any() and np.nanmedian(scatter) > _SCATTER_PX:
        raise CalibrationError(
            'the codes do not run evenly over the board: photographs are out of order, or the '
            'projector and the sequence have different sizes'
        )
    if known.sum() < 8:
        if not troubles:
            raise CalibrationError(
                f'the projected codes are read at {known.sum()} corners, fewer than 8: light the '
                'whole board, and see that the photographs are in order'
            )
        return
    plane, inliers = cv2.findHomography(
        board.points[known, :2], projected[known], cv2.RANSAC, _BENT * sequence.width
    )
    share = 1.0 if plane is None else 1 - float(np.mean(np.asarray(inliers)))
    if share > _BEND_SHARE:
        raise CalibrationError(
            f'the codes jump: at {100 * share:.0f} % of the corners they do not lie on a plane: '
            'photographs are out of order'
        )


def _contrast(photographs: Photographs, part: tuple[slice, slice]) -> float:
    stack = np.stack([image[part] for frame, image in photographs.items() if frame.axis])
    span = stack.max(axis=0).astype(float) - stack.min(axis=0)
    return float(np.percentile(span, 75))
