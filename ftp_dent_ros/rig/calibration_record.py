"""Where a rig comes from and how well it is known: the block ``calibration`` of ``rig.yaml``."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import RigError

# The rig's numbers, in the order of the covariance.
PARAMETERS = tuple(
    f'{lens}.{name}'
    for lens in ('camera', 'projector')
    for name in ('f_x', 'f_y', 'c_x', 'c_y', 'k1', 'k2', 'p1', 'p2', 'k3')
) + tuple(f'extrinsics.{name}' for name in ('r_x', 'r_y', 'r_z', 't_x', 't_y', 't_z'))
_RMS = ('camera', 'projector', 'joint')


@dataclass(frozen=True, eq=False)
class CalibrationRecord:
    """Provenance of a rig.

    Attributes
    ----------
    id : str
        The rig's `Rig.id` when it was calibrated.
    date : str
        UTC, ISO 8601.
    tool : str
    board : str
    poses : int
    rms_px : dict of str to float
        Of camera, projector and joint, over the poses fitted, pixels.
    held_out_rms_px : dict of str to float
        The same of poses not fitted to; empty if there were too few.
    depth_range : tuple of two floats
        Of the board in the camera's frame, metres.
    covariance : ndarray, shape (24, 24), optional
        Of `PARAMETERS`; the rotation as a rotation vector. None if it is not known.
    """

    id: str
    date: str
    tool: str
    board: str
    poses: int
    rms_px: dict[str, float]
    held_out_rms_px: dict[str, float] = field(default_factory=dict)
    depth_range: tuple[float, float] = (0.0, 0.0)
    covariance: NDArray[np.float64] | None = None

    def fields(self) -> dict[str, Any]:
        """The block of ``rig.yaml``."""
        block: dict[str, Any] = {
            'id': self.id,
            'date': self.date,
            'tool': self.tool,
            'board': self.board,
            'poses': self.poses,
            'rms_px': _rounded(self.rms_px),
            'held_out_rms_px': _rounded(self.held_out_rms_px),
            'depth_range': [round(value, 4) for value in self.depth_range],
        }
        if self.covariance is not None:
            block['covariance'] = {
                'parameters': list(PARAMETERS),
                'rows': len(PARAMETERS),
                'cols': len(PARAMETERS),
                'data': [float(f'{value:.9g}') for value in self.covariance.ravel()],
            }
        return block


def record_from_fields(block: Any) -> CalibrationRecord:
    """Record of the block ``calibration``.

    Raises
    ------
    RigError
        A field is missing or malformed.
    """
    if not isinstance(block, dict):
        raise RigError('the block calibration holds no fields: remove it or calibrate again')
    texts = {name: _text(block, name) for name in ('id', 'date', 'tool', 'board')}
    poses = block.get('poses')
    if isinstance(poses, bool) or not isinstance(poses, int) or poses < 0:
        raise RigError(f'calibration.poses is {poses!r}, not a number of poses: correct it')
    span = block.get('depth_range', [0.0, 0.0])
    if not isinstance(span, list) or len(span) != 2 or not all(map(_is_number, span)):
        raise RigError(f'calibration.depth_range is {span!r}, not two numbers: correct it')
    return CalibrationRecord(
        **texts,
        poses=poses,
        rms_px=_rms(block, 'rms_px'),
        held_out_rms_px=_rms(block, 'held_out_rms_px'),
        depth_range=(float(span[0]), float(span[1])),
        covariance=_covariance(block.get('covariance')),
    )


def _text(block: dict[str, Any], name: str) -> str:
    value = block.get(name)
    if value is None or isinstance(value, (dict, list)) or not str(value).strip():
        raise RigError(f'calibration.{name} is {value!r}, not a text: correct it')
    return str(value)


def _rms(block: dict[str, Any], name: str) -> dict[str, float]:
    values = block.get(name, {})
    known = isinstance(values, dict) and set(values) <= set(_RMS)
    if not known or not all(map(_is_number, values.values())):
        raise RigError(f'calibration.{name} is {values!r}: give {", ".join(_RMS)} in pixels')
    return {key: float(value) for key, value in values.items()}


def _covariance(block: Any) -> NDArray[np.float64] | None:
    if block is None:
        return None
    count = len(PARAMETERS)
    if not isinstance(block, dict) or block.get('parameters') != list(PARAMETERS):
        raise RigError('calibration.covariance is not of the known parameters: calibrate again')
    data = block.get('data')
    if not isinstance(data, list) or len(data) != count**2 or not all(map(_is_number, data)):
        raise RigError(
            f'calibration.covariance.data is not a list of {count**2} finite numbers: correct it'
        )
    matrix = np.array(data, float).reshape(count, count)
    scale = np.sqrt(np.outer(np.abs(np.diag(matrix)), np.abs(np.diag(matrix)))) + 1e-300
    symmetric = np.abs(matrix - matrix.T).max() <= 1e-6 * np.abs(matrix).max(initial=0.0)
    if not symmetric or (np.diag(matrix) < 0).any() or (np.abs(matrix) > 1.001 * scale).any():
        raise RigError('calibration.covariance is no covariance matrix: calibrate again')
    return matrix


def _is_number(value: Any) -> bool:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and math.isfinite(value)


def _rounded(values: dict[str, float]) -> dict[str, float]:
    return {key: round(float(value), 4) for key, value in values.items()}
