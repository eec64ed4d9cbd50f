"""Whether a calibrated rig can be: lenses, baseline, and what camera and projector share.

A calibration in other units, of another order or of other devices reads as well as a right one,
and gives clouds that look right. What no rig can have is refused here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ftp_dent_ros.errors import RigError

if TYPE_CHECKING:
    from ftp_dent_ros.rig.rig import Lens, Rig


# A drone carries less than the one and resolves nothing with the other, metres.
_LONGEST_BASELINE, _SHORTEST_BASELINE = 5.0, 0.005
# Where both may look: multiples of the baseline along the camera's rays.
_DISTANCES = np.geomspace(0.5, 200.0, 40)
# Of the baseline, the part across the projector's view; and that across its fringes.
_LEAST_ACROSS = 0.2


def check_geometry(rig: Rig) -> None:
    """Raise `RigError` if no camera and projector can be as `rig` has them."""
    for name, lens in (('camera', rig.camera), ('projector', rig.projector)):
        _check_lens(lens, name)
    baseline = float(np.linalg.norm(rig.translation))
    if not _SHORTEST_BASELINE <= baseline <= _LONGEST_BASELINE:
        unit = ' (it seems to be in millimetres)' if baseline > _LONGEST_BASELINE else ''
        raise RigError(
            f'extrinsics.translation is a baseline of {baseline:g} m{unit}, outside '
            f'{_SHORTEST_BASELINE:g} to {_LONGEST_BASELINE:g} m: give it in metres'
        )
    if np.linalg.norm(rig.translation[:2]) < _LEAST_ACROSS * baseline:
        raise RigError(
            'extrinsics.translation puts the projector behind or before the camera, where '
            'no fringes move with the depth: put it beside the camera, or check that '
            'X_p = rotation X_c + translation'
        )
    _check_view(rig, baseline)


def moves_fringes(rig: Rig, axis: str) -> bool:
    """Whether the depth moves fringes of the axis u or v, for a baseline across them."""
    across = abs(rig.translation['uv'.index(axis)])
    return bool(across >= _LEAST_ACROSS * np.linalg.norm(rig.translation))


def _check_lens(lens: Lens, name: str) -> None:
    size = np.array([lens.width, lens.height])
    focal, (u, v) = lens.camera_matrix[[0, 1], [0, 1]], lens.camera_matrix[:2, 2]
    # Views of 2 * atan(0.5 / x), 1 to 157 degrees.
    view = focal.min() / size.max() >= 0.1 and focal.max() / size.max() <= 57
    # Pixels of micromirrors stand on their corners, twice as far apart one way as the other.
    pixels = 1 / 2.5 <= focal[0] / focal[1] <= 2.5
    # A projector's lens shift may put the principal point one image's size beside the image.
    shift = np.abs([u, v] / size - 0.5).max() <= 0.5 + 1.0
    if not (view and pixels and shift):
        raise RigError(
            f'{name}.camera_matrix has the focal lengths {focal[0]:g} and {focal[1]:g} and the '
            f'principal point {u:g}, {v:g}, which are too short, too long, too far from each '
            f'other or too far outside {lens.width}x{lens.height} pixels for any lens: give them '
            'in pixels, or calibrate again'
        )


def _check_view(rig: Rig, baseline: float) -> None:
    """Refuse a rig whose projector lights nothing that its camera sees."""
    rays = rig.camera.rays(rig.camera.sample_grid(17, 17)).reshape(-1, 3)
    points = rig.to_projector(rays[:, None] * (baseline * _DISTANCES)[:, None])
    # Without distortion, which is a polynomial that runs wild outside the image.
    straight = replace(rig.projector, distortion=np.zeros(5))
    with np.errstate(all='ignore'):
        pixels = straight.project(points)
        inside = (pixels >= 0) & (pixels <= [straight.width, straight.height])
    if not (inside.all(axis=-1) & (points[..., 2] > 0)).any():
        raise RigError(
            'extrinsics turn the projector away: it lights nothing that the camera sees: '
            'check that X_p = rotation X_c + translation'
        )
