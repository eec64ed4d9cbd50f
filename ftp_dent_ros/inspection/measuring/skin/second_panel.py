"""Whether what departs from a panel's contour is another panel: a lap or a step has no gap."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.skin.contour import Contour
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice

# Part of a panel that one plane beside the first panel's contour has to explain.
_EXPLAINED = 0.6
# Part of a step by which what is measured with few wavelengths rings beside it (Gibbs).
_RINGING = 0.09
# Cells of a second panel without its rim, at least.
_FEWEST = 50
# Cells across the middle of the narrowest second panel, without its rim of two.
_NARROWEST = 5
# Part of a second panel's height that is risen within a cell's neighbours at its border.
_STEPPED = 0.55

Mask = NDArray[np.bool_]
Map = NDArray[np.float32]


def another_panel(
    contour: Contour,
    lattice: Lattice,
    deviation: Map,
    rest: Mask,
    part: Mask,
    tolerance: float,
) -> Mask | None:
    """Cells of `rest` on a surface parallel or tilted to the contour, if they are its most.

    Parameters
    ----------
    contour : Contour
        Of the panel that `part` is taken for.
    lattice : Lattice
    deviation : ndarray, shape (rows, columns), float32
        Depth below the contour, metres.
    rest, part : ndarray, shape (rows, columns), bool
        Connected cells that deviate, and all of those that the contour was fitted to.
    tolerance : float
        Deviation within which cells agree with the contour, metres.
    """
    kernel = np.ones((3, 3), np.uint8)
    outside = cv2.dilate((~part).astype(np.uint8), kernel, borderValue=1) > 0
    if not (rest & outside).any() and not at_frame(rest):
        return None
    core = core_of(rest)
    if not core.any() or not is_stepped(deviation, rest, core, part):
        return None
    return _on_plane(contour, lattice, deviation, core, tolerance)


def beside_contour(
    contour: Contour, lattice: Lattice, deviation: Map, rest: Mask, tolerance: float
) -> Mask | None:
    """Cells of `rest` on one plane beside the contour, if they are most of it.

    Parameters
    ----------
    contour : Contour
    lattice : Lattice
    deviation : ndarray, shape (rows, columns), float32
        Depth below the contour, metres.
    rest : ndarray, shape (rows, columns), bool
        Connected cells that deviate.
    tolerance : float
        Deviation within which cells agree with the contour, metres.
    """
    return _on_plane(contour, lattice, deviation, core_of(rest), tolerance)


def _on_plane(
    contour: Contour, lattice: Lattice, deviation: Map, core: Mask, tolerance: float
) -> Mask | None:
    """Cells on one plane beside the contour, if they are most of those that deviate."""
    if core.sum() < _FEWEST:
        return None
    x, y, _ = contour.local(lattice.points[core])
    depth = deviation[core].astype(float)
    basis = np.stack([np.ones(len(x)), x, y], axis=1).astype(float)
    weight = np.ones(len(x))
    for _ in range(15):
        weighted = basis * weight[:, None]
        solution = np.linalg.lstsq(weighted.T @ basis, weighted.T @ depth, rcond=None)[0]
        left = np.abs(depth - basis @ solution)
        weight = 1 / np.maximum(left, tolerance / 5)
    tolerance = max(tolerance, _RINGING * float(np.median(np.abs(depth))))
    if (left < tolerance).mean() < _EXPLAINED:
        return None
    agreed = np.zeros_like(core)
    agreed[core] = left < 3 * tolerance
    # A sliver is the rim's artefact.
    square = np.ones((_NARROWEST, _NARROWEST), np.uint8)
    middle = cv2.erode(
        agreed.astype(np.uint8), square, borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    return agreed if middle.any() else None


def is_stepped(deviation: Map, rest: Mask, core: Mask, part: Mask) -> bool:
    """Whether cells stand off those around them within a cell or two: waves rise slowly."""
    rise, measured = rise_of(deviation, part)
    kernel = np.ones((3, 3), np.uint8)
    border = (cv2.dilate(rest.astype(np.uint8), kernel) > 0) & ~rest & measured
    if not border.any():
        return True
    return bool(np.median(rise[border]) > _STEPPED * np.median(np.abs(deviation[core])))


def rise_of(deviation: Map, part: Mask, reach: int = 1) -> tuple[Map, Mask]:
    """Steepest rise within a reach of cells, near each cell, and where all of them are known."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    rise = cv2.dilate(deviation, kernel) - cv2.erode(deviation, kernel)
    whole = cv2.erode(part.astype(np.uint8), kernel, borderValue=0) > 0
    steepest = cv2.dilate(np.where(whole, rise, np.float32(0)), np.ones((7, 7), np.uint8))
    return np.asarray(steepest), whole


def core_of(rest: Mask) -> Mask:
    """Cells but for the rim of two."""
    return np.asarray(cv2.erode(rest.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)


def at_frame(mask: Mask) -> bool:
    """Whether any cell lies at the lattice's frame."""
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
