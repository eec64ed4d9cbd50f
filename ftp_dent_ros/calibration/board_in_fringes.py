"""A board's corners and the projector's columns there, from a photograph in the flight's pattern.

The print is predicted where its corners have it, under the fringes that the rig throws on it. In a
window about each corner linear least squares tell how far the print is shifted, and how far ahead
the fringes are.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern.pattern import Pattern, fringe_order
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig

# Pixels of a print, a square.
_PIXELS = 32
# Blur of the edges at first, wide, for corners are known to a few camera pixels then; those that
# are tried afterwards, of which the photograph chooses.
_FIRST_BLUR, _BLURS = 2.0, (0.5, 0.8, 1.2, 1.7)
# Corners and columns known worse than this tell nothing; camera and projector pixels.
_WORST_PX = 0.5
# Fewer corners, or windows in which fringes are seen, tell not how a board lies.
_FEWEST = 6


def read_board(
    rig: Rig, pattern: Pattern, board: Board, image: Photograph | NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Read a board in the flight's pattern.

    Returns
    -------
    corners : ndarray, shape (n, 2)
        Pixels of the camera, in the order of the board's points; NaN where not seen.
    points : ndarray, shape (n, 3)
        Where each corner lies as all together have the board, metres.
    columns : ndarray, shape (n,)
        Projector pixel along the pattern's axis that lights `points`; NaN where not seen.

    Raises
    ------
    CalibrationError
        The board is not seen whole, or the fringes do not tell their order on it.
    """
    photograph = linear_photograph(image, rig)
    view = _View(rig, pattern, board, fringe_levels(photograph))
    albedo, seen = view.recognised()
    seen = view.fit(albedo, seen.corners, seen.off, _BLURS[1])
    order = _order_by_code(pattern, photograph.rgb()[seen.box], seen.albedo, seen.column)
    off = seen.off - [order * pattern.period_px, 0, 0]
    tries = [view.fit(albedo, seen.corners, off, blur) for blur in _BLURS]
    best = min(tries, key=lambda each: each.misfit)
    return best.corners, best.points, best.columns


def linear_photograph(image: Photograph | NDArray, rig: Rig) -> Photograph:
    """The photograph with levels that grow with the light, if the rig knows the response."""
    photograph = Photograph.of(image)
    return photograph if rig.response is None else photograph.linear(rig.response)


def fringe_levels(photograph: Photograph) -> NDArray[np.float64]:
    """Grey levels, shape (height, width), of the colour that all fringes have: red."""
    return photograph.rgb()[..., 0].astype(float) * photograph.unit


def board_pose(
    rig: Rig, points: NDArray, corners: NDArray
) -> tuple[Rotation, NDArray[np.float64]]:
    """Turn and shift of a board in the camera's frame, by its points and the pixels of them."""
    _, turn, shift = cv2.solvePnP(points, corners, rig.camera.camera_matrix, rig.camera.distortion)
    return Rotation.from_rotvec(np.ravel(turn)), np.ravel(shift).astype(float)


def plane_terms(board: Board, place: NDArray) -> NDArray[np.float64]:
    """1, and x and y from -1/2 to 1/2 over the board, of places (n, 2 or more) on it, metres."""
    across = place[:, :2] / board.points[-1, :2] - 0.5
    return np.column_stack([np.ones(len(place)), across])


@dataclass(frozen=True, eq=False)
class _Fit:
    """A board fitted once: as `read_board` has it, and what helps to fit it again.

    Attributes
    ----------
    corners, points, columns : ndarray
        The columns up to a whole number of periods before these are counted.
    off : ndarray, shape (3,)
        Coefficients of the columns' error over the board.
    misfit : float
        Mean square of what is not explained, levels.
    box : tuple of two slices
        Rows and columns of the photograph with the board.
    column, albedo : ndarray
        At each pixel of the box: the projector's column, and how white the print is.
    """

    corners: NDArray[np.float64]
    points: NDArray[np.float64]
    columns: NDArray[np.float64]
    off: NDArray[np.float64]
    misfit: float
    box: tuple[slice, slice]
    column: NDArray[np.float64]
    albedo: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _View:
    """The fringes' levels in a photograph of a board by a rig in its pattern."""

    rig: Rig
    pattern: Pattern
    board: Board
    levels: NDArray[np.float64]

    @property
    def axis(self) -> int:
        """The projector's axis along which the fringes follow one another."""
        return 'uv'.index(self.pattern.axis)

    def recognised(self) -> tuple[NDArray[np.float64], _Fit]:
        """The print as it is seen, and a first fit: which end, and which colour, fits best."""
        board = self.board
        plain = replace(board, dictionary='', marker=0.0, legacy=False)
        rough = plain.find_rough(self.without_fringes())
        size = (board.columns + 2) * _PIXELS, (board.rows + 2) * _PIXELS
        large = board.draw(board.exact_pixels(_PIXELS))
        drawn = np.asarray(cv2.resize(large, size, interpolation=cv2.INTER_AREA), float) / 255.0
        other, turned = drawn, rough[::-1].copy()
        if not board.dictionary:
            # A chessboard whose first square is white, or which is seen from its other end.
            other, turned, half = drawn.copy(), rough, _PIXELS // 2
            other[half:-half, half:-half] = 1 - drawn[half:-half, half:-half]
        tries = []
        for albedo, corners in ((drawn, rough), (other, turned)):
            with suppress(CalibrationError):
                tries.append((albedo, self.fit(albedo, corners, np.zeros(3), _FIRST_BLUR)))
        if not tries:
            raise CalibrationError('the fringes are not seen on the board: light the whole of it')
        return min(tries, key=lambda each: each[1].misfit)

    def without_fringes(self) -> NDArray[np.uint8]:
        """The photograph without its fringes: a window of two periods has a zero at theirs."""
        lenses = self.rig.camera, self.rig.projector
        focal, thrown = (lens.camera_matrix[self.axis, self.axis] for lens in lenses)
        window = np.hanning(2 * round(self.pattern.period_px * focal / thrown) + 3)[1:-1]
        smooth = cv2.sepFilter2D(self.levels.astype(np.float32), -1, window, window)
        white = max(float(np.percentile(smooth, 99)), 1e-3)
        return np.clip(smooth * (230 / white), 0, 255).astype(np.uint8)

    def fit(self, albedo: NDArray, corners: NDArray, off: NDArray, blur: float) -> _Fit:
        """Fit each corner's window with the board where `corners` have it."""
        rig, pattern, board, axis = self.rig, self.pattern, self.board, self.axis
        known = np.isfinite(corners[:, 0])
        if known.sum() < _FEWEST:
            raise CalibrationError(
                f'fewer than {_FEWEST} corners of the board are seen: light the whole of it'
            )
        turn, shift = board_pose(rig, board.points[known], corners[known])
        points = turn.apply(board.points) + shift
        middles = rig.camera.project(points)
        # A window's side over the square's, so that no pixel is in two.
        half = max(4, int(0.95 / 2 * board.spacing(middles)))
        low = np.maximum(np.floor(middles.min(axis=0)).astype(int) - half - 2, 0)
        high = np.ceil(middles.max(axis=0)).astype(int) + half + 3
        seen = self.levels[low[1] : high[1], low[0] : high[0]]
        box = slice(low[1], low[1] + seen.shape[0]), slice(low[0], low[0] + seen.shape[1])
        v, u = np.mgrid[box]
        rays = rig.camera.rays(np.stack([u, v], axis=-1).reshape(-1, 2))
        normal = turn.apply([0.0, 0.0, 1.0])
        on = rays * ((shift @ normal) / (rays @ normal))[:, None]
        place = turn.inv().apply(on - shift)[:, :2]
        lit_by = rig.projector.project(rig.to_projector(on))
        over = plane_terms(board, place)
        column = lit_by[:, axis] + over @ off
        upright = pattern.transposed if axis else pattern
        phase = pattern.phase(column)
        contrast = upright.contrast(phase) * upright.row_contrast(lit_by[:, 1 - axis])
        at = ((place / board.square + 1.5) * _PIXELS - 0.5).astype(np.float32)
        soft = gaussian_filter(albedo, blur * _PIXELS / board.spacing(middles)).astype(np.float32)
        x, y = at.T.reshape(2, *u.shape)
        white = cv2.remap(soft, x, y, cv2.INTER_LINEAR, borderValue=1.0).astype(float)
        slope_y, slope_x = np.gradient(white)
        waves = phase.reshape(u.shape), contrast.reshape(u.shape)
        pictures = np.stack([seen, white, slope_x, slope_y, *waves])
        found, misfits = np.full((len(points), 3), np.nan), []
        for index, (x, y) in enumerate(np.rint(middles).astype(int) - low):
            window = pictures[:, max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1]
            if window.shape[1:] == (2 * half + 1, 2 * half + 1):
                found[index], misfit = _fit_window(window.reshape(6, -1), pattern.period_px)
                misfits.append(misfit)
        found[np.hypot(*found[:, :2].T) >= half, :2] = np.nan
        ahead = found[:, 2]
        lit = np.isfinite(ahead)
        if lit.sum() < _FEWEST:
            raise CalibrationError('the fringes are not seen on the board: light the whole of it')
        turns = np.exp(2j * np.pi / pattern.period_px * ahead)
        mean = np.nanmean(turns)
        ahead = pattern.period_px / (2 * np.pi) * (np.angle(turns / mean) + np.angle(mean))
        terms = plane_terms(board, board.points)
        predicted = rig.projector.project(rig.to_projector(points))[:, axis] + terms @ off
        more, *_ = np.linalg.lstsq(terms[lit], ahead[lit], rcond=None)
        return _Fit(
            middles + found[:, :2],
            points,
            predicted + ahead,
            off + more,
            float(np.mean(misfits)),
            box,
            (column + over @ more).reshape(u.shape),
            white,
        )


def _fit_window(window: NDArray, period_px: float) -> tuple[NDArray[np.float64], float]:
    """Fit the light on white and on ink, and the print's shift, by linear least squares.

    On white it is its mean, fringes and their second harmonic; on ink, which reflects a little,
    its mean and fringes.

    Parameters
    ----------
    window : ndarray, shape (6, m)
        Of its pixels: levels, how white the print is there and the slopes of that along x and y,
        phase and contrast of the fringes as predicted.
    period_px : float

    Returns
    -------
    found : ndarray, shape (3,)
        Shift of the print, camera pixels, and columns by which the fringes are ahead of those
        predicted, projector pixels; NaN where it is not known.
    misfit : float
        Mean square of what is left, levels.
    """
    seen, albedo, slope_x, slope_y, phase, contrast = window
    waves = np.column_stack(
        [
            np.ones_like(phase),
            *(contrast**n * wave(n * phase) for n in (1, 2) for wave in (np.cos, np.sin)),
        ]
    )
    on_ink = waves[:, :3]
    terms = still = np.column_stack([albedo[:, None] * waves, (1 - albedo)[:, None] * on_ink])
    for _ in range(3):
        inverse = np.linalg.pinv(terms.T @ terms, hermitian=True)
        numbers = inverse @ (terms.T @ seen)
        left = float(np.square(seen - terms @ numbers).sum())
        spread = np.sqrt(np.diag(inverse) * left / max(1, len(seen) - terms.shape[1]))
        step = waves @ numbers[:5] - on_ink @ numbers[5:8]
        terms = np.column_stack([still, -step * slope_x, -step * slope_y])
    strength = max(float(np.hypot(numbers[1], numbers[2])), 1e-9)
    per_turn = period_px / (2 * np.pi)
    ahead, ahead_px = -np.arctan2(numbers[2], numbers[1]), spread[1:3].max() / strength
    found = np.array([*numbers[-2:], per_turn * ahead])
    doubt = np.repeat([spread[-2:].max(), per_turn * ahead_px], [2, 1])
    return np.where(doubt < _WORST_PX, found, np.nan), left / len(seen)


def _order_by_code(pattern: Pattern, rgb: NDArray, albedo: NDArray, column: NDArray) -> int:
    """Order that the fringe has whose code is that of order 0; 0 if the columns are right.

    Parameters
    ----------
    pattern : Pattern
    rgb : ndarray, shape (height, width, 3)
        Colours of the board's photograph, growing with the light.
    albedo, column : ndarray, shape (height, width)
        How white the print is at each pixel, 0 to 1, and the projector's column that lights it,
        known up to a whole number of periods.

    Raises
    ------
    CalibrationError
        The code is not seen on the board.
    """
    upright = pattern if pattern.axis == 'u' else pattern.transposed
    # Where the print is so white, pixels are of one colour.
    white = albedo > 0.9
    phase, colours = pattern.phase(column[white]), rgb[white].astype(float)
    order = fringe_order(phase)
    least, half = int(order.min()), np.cos(phase) > 0

    def means(part: NDArray[np.bool_], colour: int) -> NDArray[np.float64]:
        """Of each fringe; of at least so many pixels."""
        count = np.bincount(order[part] - least, minlength=np.ptp(order) + 1)
        total = np.bincount(order[part] - least, colours[part, colour], minlength=len(count))
        return np.where(count < 30, np.nan, total / np.maximum(count, 1))

    orders = np.array(upright.fringe_orders)
    if pattern.code == 'stripe':
        seen, code = means(half, 1) / means(half, 0), (orders != 0).astype(float)
    else:
        bright, dark = means(half, 0), means(~half, 0)
        contrast = (bright - dark) / (bright + dark)
        # The board's rim may cut a fringe's half.
        seen = np.clip(contrast, *np.nanpercentile(contrast, [10, 90]))
        code = upright.fringe_contrast(orders)
    known = np.flatnonzero(np.isfinite(seen))
    # Over fewer fringes any code is found.
    shifts = range(-known[0], len(code) - known[-1]) if len(known) >= 12 else range(0)
    with np.errstate(invalid='ignore'):
        found = [np.corrcoef(code[known + shift], seen[known])[0, 1] for shift in shifts]
    alike, shift = max(zip(np.nan_to_num(found), shifts, strict=True), default=(0.0, 0))
    # What is read of a fringe goes with its code like this.
    if alike < 0.8:
        what = 'red stripe' if pattern.code == 'stripe' else "code of the fringes' contrast"
        raise CalibrationError(
            f'the {what} is not seen on the board: see that it is in the light of this pattern, '
            'in focus, and that the stripe runs over it if there is one'
        )
    return least - shift - int(orders[0])
