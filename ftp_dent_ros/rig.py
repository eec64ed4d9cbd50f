"""The rig: camera, projector and the pose between them, and its file ``rig.yaml``.

A projector is an inverse camera: the same lens model maps an ideal ray to the pixel that lights
it.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from ftp_dent_ros.calibration_record import CalibrationRecord, record_from_fields
from ftp_dent_ros.errors import RigError
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.lens import Lens
from ftp_dent_ros.rig_fields import lens_fields, lens_from, matrix_of, numbers_of, response_from
from ftp_dent_ros.rig_geometry import check_geometry
from ftp_dent_ros.yaml_file import read_yaml

# Far below what a calibration knows, and far above rounding in a hand-copied file.
_ORTHONORMAL = 1e-6
_BLOCKS = ('camera', 'projector', 'extrinsics')


@dataclass(frozen=True, eq=False)
class Rig:
    """A calibrated camera and projector: ``X_p = rotation @ X_c + translation``.

    Attributes
    ----------
    camera, projector : Lens
    rotation : ndarray, shape (3, 3)
        From the camera's optical frame (x right, y down, z forward) to the projector's.
    translation : ndarray, shape (3,)
        Metres.
    record : CalibrationRecord, optional
        Where the rig comes from, and the covariance of its numbers.
    response : ndarray, shape (levels,), optional
        Light, from 0 to 1, of evenly spaced levels of the camera's pixels, from black to white,
        for a camera that is not linear; straight between them.
    """

    camera: Lens
    projector: Lens
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    record: CalibrationRecord | None = None
    response: NDArray[np.float64] | None = None

    @cached_property
    def id(self) -> str:
        """Twelve hexadecimal digits that name these numbers, whoever calibrated them."""
        numbers = [
            [lens.width, lens.height, *lens.camera_matrix.ravel(), *lens.distortion]
            for lens in (self.camera, self.projector)
        ]
        everything = np.concatenate([*numbers, self.rotation.ravel(), self.translation])
        digest = hashlib.sha256(everything.astype('<f8').tobytes())
        return digest.hexdigest()[:12]

    @property
    def transposed(self) -> Rig:
        """The same rig with x for y, and y for x, of pixels as of frames; without its record."""
        rotation = self.rotation[[1, 0, 2]][:, [1, 0, 2]]
        translation = self.translation[[1, 0, 2]]
        return Rig(self.camera.transposed, self.projector.transposed, rotation, translation)

    @property
    def projector_centre(self) -> NDArray[np.float64]:
        """Optical centre of the projector in the camera's frame, shape (3,), metres."""
        return -self.rotation.T @ self.translation

    def to_projector(self, points: ArrayLike) -> NDArray[np.float64]:
        """Points of shape (..., 3), from the camera's frame to the projector's."""
        return np.asarray(points, float) @ self.rotation.T + self.translation

    def to_camera(self, points: ArrayLike) -> NDArray[np.float64]:
        """Points of shape (..., 3), from the projector's frame to the camera's."""
        return (np.asarray(points, float) - self.translation) @ self.rotation


def read_rig(path: str | os.PathLike[str]) -> Rig:
    """Read ``rig.yaml``.

    Raises
    ------
    RigError
        The file cannot be read, or a field is missing, malformed or impossible; the message
        names the field.
    """
    data = read_yaml(path, RigError)
    if data.keys().isdisjoint(_BLOCKS):
        raise RigError(
            f"{path}: holds none of a rig's blocks ({', '.join(_BLOCKS)}): check the path"
        )
    try:
        rotation = matrix_of(data, 'extrinsics', 'rotation', (3, 3))
        with np.errstate(over='ignore', invalid='ignore'):
            deviation = np.abs(rotation @ rotation.T - np.eye(3)).max()
            determinant = np.linalg.det(rotation)
        if not deviation <= _ORTHONORMAL or determinant < 0:
            raise RigError(
                f'extrinsics.rotation is not a rotation (R R^T is off by {deviation:.2g}, '
                f'det {determinant:.3g}): calibrate again'
            )
        translation = numbers_of(data, 'extrinsics', 'translation', 3)
        if np.linalg.norm(translation) == 0:
            raise RigError(
                'extrinsics.translation is zero, and without a baseline there is no depth: '
                'give it in metres'
            )
        record = record_from_fields(data['calibration']) if 'calibration' in data else None
        rig = Rig(
            lens_from(data, 'camera'),
            lens_from(data, 'projector'),
            rotation,
            translation,
            record,
            response_from(data),
        )
        if record is not None and record.id != rig.id:
            raise RigError(
                f'calibration.id is {record.id}, but the numbers are those of {rig.id}: they were '
                'changed after the calibration: restore them, or remove the block calibration'
            )
        check_geometry(rig)
        return rig
    except RigError as reason:
        raise RigError(f'{path}: {reason}') from None


def write_rig(path: str | os.PathLike[str], rig: Rig) -> None:
    """Write ``rig.yaml``; a file under that name is whole or not there."""
    data: dict[str, Any] = {
        'camera': lens_fields(rig.camera),
        'projector': lens_fields(rig.projector),
        'extrinsics': {
            'rotation': {'rows': 3, 'cols': 3, 'data': rig.rotation.ravel().tolist()},
            'translation': rig.translation.tolist(),
        },
    }
    if rig.response is not None:
        data['camera']['response'] = rig.response.tolist()
    if rig.record is not None:
        data['calibration'] = rig.record.fields()
    with written_aside(path) as aside:
        text = yaml.safe_dump(data, sort_keys=False, default_flow_style=None)
        aside.write_text(text, encoding='utf-8')
