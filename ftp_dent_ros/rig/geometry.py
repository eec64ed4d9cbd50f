"""Whether a calibrated rig can be: lenses, baseline, and what camera and projector share.

A calibration in other units, of another order or of other devices reads as well as a right one,
and gives clouds that look right. What no rig can have is refused here.
"""

from __future__ import annotations

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
    side = max(lens.width, lens.height)
    focal = lens.camera_matrix[[0, 1], [0, 1]]
    # Views of 2 * atan(0.5 / x), 1 to 157 degrees.
    if (focal < 0.1 * side).any() or (focal > 57 * side).any():
        raise RigError(
            f'{name}.camera_matrix has the focal lengths {focal[0]:g} and {focal[1]:g} for an '
            f'image of {lens.width}x{lens.height}, which no lens has: give them in pixels'
        )
    # Pixels of micromirrors stand on their corners, twice as far apart one way as the other.
    if not 1 / 2.5 <= focal[0] / focal[1] <= 2.5:
        raise RigError(
            f'{name}.camera_matrix has the focal lengths {focal[0]:g} and {focal[1]:g}, too far '
            'from each other for any pixels: calibrate again'
        )
    size = np.array([lens.width, lens.height])
    # A projector's lens shift may put the principal point one image's size beside the image.
    if (np.abs(lens.camera_matrix[:2, 2] / size - 0.5) > 0.5 + 1.0).any():
        u, v = lens.camera_matrix[:2, 2]
        raise RigError(
            f'{name}.camera_matrix has the principal point {u:g}, {v:g}, far outside the image '
            f'of {lens.width}x{lens.height}: calibrate again'
        )


def _check_view(rig: Rig, baseline: float) -> None:
    """Refuse a rig whose projector lights nothing that its camera sees."""
    edge = np.linspace(0, 1, 17)
    u, v = np.meshgrid(edge * (rig.camera.width - 1), edge * (rig.camera.height - 1))
    rays = rig.camera.rays(np.stack([u, v], axis=-1)).reshape(-1, 3)
    points = rig.to_projector(rays[:, None] * (baseline * _DISTANCES)[:, None])
    ahead = points[..., 2] > 0
    with np.errstate(all='ignore'):
        ideal = points[..., :2] / points[..., 2:]
        focal = rig.projector.camera_matrix[[0, 1], [0, 1]]
        # Without distortion, which is a polynomial that runs wild outside the image.
        pixels = focal * ideal + rig.projector.camera_matrix[:2, 2]
        inside = (pixels >= 0) & (pixels <= [rig.projector.width, rig.projector.height])
    lit = ahead & inside.all(axis=-1)
    if not lit.any():
        raise RigError(
            'extrinsics turn the projector away: it lights nothing that the camera sees: '
            'check that X_p = rotation X_c + translation'
        )
