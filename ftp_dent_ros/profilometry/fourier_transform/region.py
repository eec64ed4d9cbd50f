"""The region of interest: where the image shows fringes. Nobody draws a rectangle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from ftp_dent_ros.errors import SaturatedError, TooDarkError
from ftp_dent_ros.profilometry.fourier_transform.carrier import Carrier

# Grey levels: an amplitude that gives a phase worth having, and peak to trough of one.
_LEAST_MODULATION = 4.0
_LEAST_CONTRAST = 2 * _LEAST_MODULATION
# Share of a fringe that must be explained, and of the lower shoulder that is still no valley.
_LEAST_SUPPORT = 0.4
_VALLEY = 0.6
# A fringe reaches from this share of its contrast on one flank to the same on the other.
_FLANK = 0.35
# A shorter run of fringes than this, in periods, fills no pass band of half the carrier.
_SHORTEST_RUN = 2.0
_LOWEST_RUN = 5  # rows
_SMALLEST_SHARE = 0.002
_CLIPPED = 254.5
# Of the image, from which on fringes may well be lost in it: more than a lamp or a highlight.
_BLINDING_SHARE = 0.02
_LARGEST_CLIPPED_SHARE = 0.5


def lit_region(red: NDArray[np.float32], carrier: Carrier) -> NDArray[np.bool_]:
    """Pixels inside the fringes, from the first bright flank of a row to the last.

    Each pixel is held against the brightest and darkest within half a fringe of it, so that
    neither vignetting nor ambient light nor paint matters; the dark troughs are closed after.

    Parameters
    ----------
    red : ndarray, shape (rows, columns), float32
        Red channel, where the fringes go on through the stripe.
    carrier : Carrier

    Returns
    -------
    ndarray, shape (rows, columns), bool

    Raises
    ------
    SaturatedError, TooDarkError
        Nowhere are there fringes; with or without a large part of the image clipped.
    """
    width = 2 * math.ceil(carrier.period / 2) + 1
    smooth = cv2.blur(red, (1, 3))
    peak = cv2.dilate(smooth, np.ones((5, width), np.uint8))
    trough = cv2.erode(smooth, np.ones((5, width), np.uint8))
    contrast = peak - trough
    bright = (contrast > _LEAST_CONTRAST) & (smooth > trough + _FLANK * contrast)
    closed = cv2.morphologyEx(
        bright.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((1, width), np.uint8)
    )
    # One pixel less on each side: the outermost is only half covered by the surface.
    trimmed = cv2.erode(closed, np.ones((3, 3), np.uint8))
    shortest = math.ceil(_SHORTEST_RUN * carrier.period)
    long = cv2.morphologyEx(trimmed, cv2.MORPH_OPEN, np.ones((1, shortest), np.uint8))
    # What is lower than a few rows is no fringe but a horizontal edge.
    region = cv2.morphologyEx(long, cv2.MORPH_OPEN, np.ones((_LOWEST_RUN, 1), np.uint8)) > 0
    if region.mean() < _SMALLEST_SHARE:
        white = float((red >= _CLIPPED).mean())
        if white > _BLINDING_SHARE:
            raise SaturatedError(
                f'no part of the image shows fringes and {white:.0%} of it is clipped: '
                'expose for a shorter time'
            )
        raise TooDarkError(
            'no part of the image shows fringes: switch the projector on, come closer, or '
            'expose longer'
        )
    return region


def clipped(
    red: NDArray[np.float32], region: NDArray[np.bool_], carrier: Carrier
) -> NDArray[np.bool_]:
    """Pixels of `region` in whose fringe most levels are clipped, so that its shape is lost.

    Clipping alone is symmetric about a fringe's peak and hardly moves its phase.

    Raises
    ------
    SaturatedError
        They are most of the region.
    """
    width = 2 * math.ceil(carrier.period / 2) + 1
    share = cv2.blur((red >= _CLIPPED).astype(np.float32), (width, 1))
    lost = region & (share > _LARGEST_CLIPPED_SHARE)
    if lost.sum() > 0.5 * region.sum():
        raise SaturatedError(
            f'the fringes are clipped over {lost.sum() / region.sum():.0%} of the lit area: '
            'expose for a shorter time'
        )
    return lost


def trusted(
    modulation: NDArray[np.float32],
    inside: NDArray[np.bool_],
    explained: NDArray[np.bool_],
    carrier: Carrier,
) -> NDArray[np.bool_]:
    """Pixels whose phase is their own.

    Most of the fringe around them is explained by fringes, and they lie in no valley of the
    modulation: over a hole, and where two surfaces meet whose fringes do not, the pass band
    mixes both sides and the modulation sinks between them. (A painted edge only falls.)

    Parameters
    ----------
    modulation : ndarray, shape (rows, columns), float32
        Amplitude of the fringes, grey levels.
    inside : ndarray, shape (rows, columns), bool
        The lit region.
    explained : ndarray, shape (rows, columns), bool
        Pixels that the fringes explain.
    carrier : Carrier

    Returns
    -------
    ndarray, shape (rows, columns), bool
    """
    width = 2 * math.ceil(carrier.period / 2) + 1
    support = cv2.blur(explained.astype(np.float32), (width, 1))
    wide = np.ones((1, 2 * width + 1), np.uint8)
    shoulders = cv2.morphologyEx(modulation, cv2.MORPH_CLOSE, wide)
    return (
        inside
        & (support > _LEAST_SUPPORT)
        & (modulation > _LEAST_MODULATION)
        & (modulation > _VALLEY * shoulders)
    )


@dataclass(frozen=True)
class Window:
    """The rows and columns around a region that are worth transforming.

    Attributes
    ----------
    rows, columns : slice
        The region's bounding box.
    before, after : int
        Columns of margin on either side; they may lie beyond the image.
    """

    rows: slice
    columns: slice
    before: int
    after: int

    @classmethod
    def around(cls, region: NDArray[np.bool_], margin: int) -> Window:
        """Window around `region`, at least `margin` wider on both sides."""
        rows, columns = (np.flatnonzero(region.any(axis=axis)) for axis in (1, 0))
        width = int(columns[-1] - columns[0]) + 1
        after = scipy.fft.next_fast_len(width + 2 * margin, real=True) - width - margin
        return cls(
            slice(int(rows[0]), int(rows[-1]) + 1),
            slice(int(columns[0]), int(columns[-1]) + 1),
            margin,
            after,
        )

    def cut(self, image: NDArray) -> NDArray:
        """Rows and columns of an image, without the margin."""
        return image[self.rows, self.columns]

    def padded(self, image: NDArray) -> NDArray:
        """Rows and columns of an image, zeros in the margin."""
        return np.pad(self.cut(image), ((0, 0), (self.before, self.after)))

    def bare(self, values: NDArray) -> NDArray:
        """Undo the margin of a padded array."""
        return values[:, self.before : values.shape[1] - self.after]
