"""Where a rig comes from and how well it is known: the block ``calibration`` of ``rig.yaml``."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import RigError
from ftp_dent_ros.fields import Count, Fields, NotNegative, Pair

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
    poses: Count
    rms_px: dict[str, float]
    held_out_rms_px: dict[str, float] = field(default_factory=dict)
    depth_range: Pair = (0.0, 0.0)
    covariance: NDArray[np.float64] | None = None

    def fields(self) -> dict[str, Any]:
        """The block of ``rig.yaml``."""
        block = asdict(replace(self, covariance=None))
        del block['covariance']
        if self.covariance is not None:
            block['covariance'] = {
                'parameters': list(PARAMETERS),
                'rows': len(PARAMETERS),
                'cols': len(PARAMETERS),
                'data': [float(f'{value:.9g}') for value in self.covariance.ravel()],
            }
        return block


def record_of(block: Fields) -> CalibrationRecord:
    """Record of the block ``calibration``; raises `RigError` with the field that is wrong."""
    given = {name: _rms(block, name) for name in ('rms_px', 'held_out_rms_px') if name in block}
    return block.record(
        CalibrationRecord,
        covariance=block.made(_covariance, block.block('covariance'))
        if 'covariance' in block
        else None,
        **given,
    )


def _rms(block: Fields, name: str) -> dict[str, float]:
    values = block.block(name)
    found = {lens: values.take(lens, NotNegative) for lens in _RMS if lens in values}
    values.finish()
    return found


def _covariance(block: Fields) -> NDArray[np.float64]:
    if block.take('parameters', list) != list(PARAMETERS):
        raise RigError('covariance is not of the known parameters: calibrate again')
    matrix = block.as_matrix(len(PARAMETERS), len(PARAMETERS))
    scale = np.sqrt(np.outer(np.abs(np.diag(matrix)), np.abs(np.diag(matrix)))) + 1e-300
    symmetric = np.abs(matrix - matrix.T).max() <= 1e-6 * np.abs(matrix).max(initial=0.0)
    if not symmetric or (np.diag(matrix) < 0).any() or (np.abs(matrix) > 1.001 * scale).any():
        raise RigError('covariance is no covariance matrix: calibrate again')
    return matrix
