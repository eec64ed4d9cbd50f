"""What varies along a skin beside its form: the marks on its paint, and the sun on parts of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.simulation.skin.surface import Surface

# Every so many pixels it is looked where a mark is.
_COARSE = 8

# float32, for which OpenCV's annotations are too wide.
Image = NDArray[Any]


def is_even(surface: Surface) -> bool:
    """Whether no panel has marks or sun."""
    return not any(panel.paint.marks or panel.sunlight for panel in surface.panels)


def paint_and_sun(
    surface: Surface, tone: NDArray[np.uint8], x: Image, y: Image, sharp_only: bool = False
) -> tuple[Image, Image]:
    """Factor on the albedo and sunlight at points of a surface.

    Parameters
    ----------
    surface : Surface
    tone : ndarray of uint8
        As in `View`: which panel is seen.
    x, y : ndarray
        Coordinates on that panel, metres, of the same shape.
    sharp_only : bool
        Marks that change over many pixels are left out.

    Returns
    -------
    factor : ndarray, shape (1 or 3, ...), float32
        On the albedo of all colours, or of red, green and blue.
    sun : ndarray, shape (...), float32
    """
    coloured = any(panel.paint.coloured for panel in surface.panels)
    factor = np.ones((3 if coloured else 1, *tone.shape), np.float32)
    sun = np.zeros(tone.shape, np.float32)
    for index, panel in enumerate(surface.panels):
        if not (panel.paint.marks or panel.sunlight):
            continue
        on_panel = tone // 2 == index
        if not on_panel.any():
            continue
        everywhere = bool(on_panel.all())
        for mark in panel.paint.marks:
            if sharp_only and mark.smooth:
                continue
            part = _around(mark.box, x, y)
            if part is None:
                continue
            values = mark.factor(x[part], y[part])
            at: Any = (slice(None), *part)
            target = factor[at]
            np.multiply(target, values, out=target, where=everywhere or on_panel[part])
        for light in panel.sunlight:
            np.add(sun, light.at(x, y), out=sun, where=everywhere or on_panel)
    return factor, sun


def smooth_paint(surface: Surface, tone: NDArray[np.uint8], x: Image, y: Image) -> Image:
    """Factor of the marks that change over many pixels, shape of `x`, float32."""
    factor = np.ones(tone.shape, np.float32)
    for index, panel in enumerate(surface.panels):
        for mark in panel.paint.marks:
            if mark.smooth:
                np.multiply(factor, mark.factor(x, y), out=factor, where=tone // 2 == index)
    return factor


def _around(
    box: tuple[float, float, float] | None, x: Image, y: Image
) -> tuple[slice, ...] | None:
    """Part of an image of panel coordinates that may lie in a box (x, y, half side)."""
    whole = (slice(None),) * x.ndim
    if box is None or x.ndim == 1:
        return whole
    centre_x, centre_y, half = box
    coarse = x[::_COARSE, ::_COARSE], y[::_COARSE, ::_COARSE]
    inside = (np.abs(coarse[0] - centre_x) < half) & (np.abs(coarse[1] - centre_y) < half)
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if not len(rows):
        # It may lie between the pixels that were looked at.
        step = max(float(np.nanmax(np.abs(np.diff(part)))) for part in coarse)
        return None if half > step else _around((centre_x, centre_y, 2 * step), x, y)
    return tuple(
        slice(max((at[0] - 1) * _COARSE, 0), (at[-1] + 2) * _COARSE) for at in (rows, columns)
    )
