"""The rig: camera, projector and the pose between them, and its file ``rig.yaml``.

A projector is an inverse camera: the same lens model maps an ideal ray to the pixel that lights
it. Pixels follow OpenCV: an integer coordinate is a pixel's centre, on the projector too.
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

from ftp_dent_ros.errors import RigError
from ftp_dent_ros.fields import Fields, Pixels, Triple
from ftp_dent_ros.files import write_atomically
from ftp_dent_ros.rig.calibration_record import CalibrationRecord, record_of
from ftp_dent_ros.rig.geometry import check_geometry
from ftp_dent_ros.yaml_file import read_yaml

# Of a camera matrix all but focal lengths and principal point.
_REST = [0, 0, 0, 0, 1]

# A level of 12 bits each.
_MOST_RESPONSE = 4096


@dataclass(frozen=True, eq=False)
class Lens:
    """Pinhole model with Brown-Conrady distortion (``plumb_bob`` of sensor_msgs/CameraInfo).

    Attributes
    ----------
    width, height : int
        Image size, pixels.
    camera_matrix : ndarray, shape (3, 3)
        ``[[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]``, pixels.
    distortion : ndarray, shape (5,)
        ``k1, k2, p1, p2, k3``.
    """

    width: int
    height: int
    camera_matrix: NDArray[np.float64]
    distortion: NDArray[np.float64]

    @property
    def transposed(self) -> Lens:
        """The same lens with columns for rows, and rows for columns."""
        matrix = self.camera_matrix[[1, 0, 2]][:, [1, 0, 2]]
        return Lens(self.height, self.width, matrix, self.distortion[[0, 1, 3, 2, 4]])

    def padded(self, pixels: int) -> Lens:
        """The same lens before an image that is so many pixels larger at each border."""
        matrix = self.camera_matrix.copy()
        matrix[:2, 2] += pixels
        return Lens(self.width + 2 * pixels, self.height + 2 * pixels, matrix, self.distortion)

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project points of shape (..., 3) in this lens's frame to pixels, shape (..., 2)."""
        points = np.asarray(points, float)
        ideal = points[..., :2] / points[..., 2:]
        distorted, _ = self._distort(ideal)
        focal = self.camera_matrix[[0, 1], [0, 1]]
        return focal * distorted + self.camera_matrix[:2, 2]

    def rays(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Undistorted rays of shape (..., 3), z = 1, through pixels of shape (..., 2)."""
        focal = self.camera_matrix[[0, 1], [0, 1]]
        distorted = (np.asarray(pixels, float) - self.camera_matrix[:2, 2]) / focal
        ideal = distorted.copy()
        for _ in range(20 if self.distortion.any() else 0):
            image, jacobian = self._distort(ideal)
            # By hand, not LAPACK: the same bits on every machine, for those who send depths alone.
            ((a, b), (c, d)), (x, y) = (
                np.moveaxis(jacobian, (-2, -1), (0, 1)),
                np.moveaxis(distorted - image, -1, 0),
            )
            step = np.stack([d * x - b * y, a * y - c * x], axis=-1) / (a * d - b * c)[..., None]
            ideal += step
            # Far below what a calibration knows.
            if np.abs(step).max(initial=0.0) < 1e-12:
                break
        return np.concatenate([ideal, np.ones((*ideal.shape[:-1], 1))], axis=-1)

    def pixel_grid(self, stride: int = 1) -> NDArray[np.float64]:
        """Centres (u, v) of every `stride`-th pixel, shape (rows, columns, 2)."""
        u, v = np.meshgrid(np.arange(0, self.width, stride), np.arange(0, self.height, stride))
        return np.stack([u, v], axis=-1).astype(float)

    def sample_grid(self, columns: int, rows: int) -> NDArray[np.float64]:
        """Pixels (u, v) from corner to corner of the image, shape (rows, columns, 2)."""
        u, v = np.linspace(0, self.width - 1, columns), np.linspace(0, self.height - 1, rows)
        return np.stack(np.meshgrid(u, v), axis=-1)

    def _distort(self, ideal: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distorted coordinates of shape (..., 2) and their Jacobian of shape (..., 2, 2)."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = ideal[..., 0], ideal[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
        distorted = np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )
        mixed = x * y * slope + 2 * p1 * x + 2 * p2 * y
        jacobian = np.stack(
            [
                radial + x * x * slope + 2 * p1 * y + 6 * p2 * x,
                mixed,
                mixed,
                radial + y * y * slope + 6 * p1 * y + 2 * p2 * x,
            ],
            axis=-1,
        ).reshape(*ideal.shape[:-1], 2, 2)
        return distorted, jacobian


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


def read_rig(path: str | os.PathLike[str]) -> Rig:
    """Read ``rig.yaml``.

    Raises
    ------
    RigError
        The file cannot be read, or a field is missing, malformed or impossible; the message
        names the field.
    """
    data = Fields(read_yaml(path, RigError), f'{path}: ', RigError)
    camera, extrinsics = data.block('camera'), data.block('extrinsics')
    rig = Rig(
        data.made(_lens, camera, 'camera'),
        data.made(_lens, data.block('projector'), 'projector'),
        extrinsics.block('rotation').as_matrix(3, 3),
        np.array(extrinsics.take('translation', Triple)),
        record_of(data.block('calibration')) if 'calibration' in data else None,
        np.array(camera.take('response', tuple[float, ...])) if 'response' in camera else None,
    )
    data.made(_check, rig)
    return rig


def _check(rig: Rig) -> None:
    """Raise `RigError` if the numbers are no rig's, or no longer those that were calibrated."""
    with np.errstate(over='ignore', invalid='ignore'):
        deviation = np.abs(rig.rotation @ rig.rotation.T - np.eye(3)).max()
        determinant = np.linalg.det(rig.rotation)
    # Far below what a calibration knows, and far above rounding in a hand-copied file.
    if not deviation <= 1e-6 or determinant < 0:
        raise RigError(
            f'extrinsics.rotation is not a rotation (R R^T is off by {deviation:.2g}, '
            f'det {determinant:.3g}): calibrate again'
        )
    light = rig.response
    if light is not None and (
        not 2 <= len(light) <= _MOST_RESPONSE
        or (light[0], light[-1]) != (0, 1)
        or (np.diff(light) <= 0).any()
    ):
        raise RigError(
            'camera.response does not rise from 0 to 1 all the way: give the light of 2 to '
            f'{_MOST_RESPONSE} evenly spaced levels, or remove it'
        )
    if rig.record is not None and rig.record.id != rig.id:
        raise RigError(
            f'calibration.id is {rig.record.id}, but the numbers are those of {rig.id}: they were '
            'changed after the calibration: restore them, or remove the block calibration'
        )
    check_geometry(rig)


def write_rig(path: str | os.PathLike[str], rig: Rig) -> None:
    """Write ``rig.yaml``; a file under that name is whole or not there."""
    data: dict[str, Any] = {
        'camera': _fields(rig.camera),
        'projector': _fields(rig.projector),
        'extrinsics': {
            'rotation': {'rows': 3, 'cols': 3, 'data': rig.rotation.ravel().tolist()},
            'translation': rig.translation.tolist(),
        },
    }
    if rig.response is not None:
        data['camera']['response'] = rig.response.tolist()
    if rig.record is not None:
        data['calibration'] = rig.record.fields()
    with write_atomically(path) as temporary:
        text = yaml.safe_dump(data, sort_keys=False, default_flow_style=None)
        temporary.write_text(text, encoding='utf-8')


def _fields(lens: Lens) -> dict[str, Any]:
    """A lens as fields of a block."""
    return {
        'image_width': lens.width,
        'image_height': lens.height,
        'camera_matrix': {'rows': 3, 'cols': 3, 'data': lens.camera_matrix.ravel().tolist()},
        'distortion_model': 'plumb_bob',
        'distortion_coefficients': {'rows': 1, 'cols': 5, 'data': lens.distortion.tolist()},
    }


def _lens(fields: Fields, block: str) -> Lens:
    """The lens of a block; raises `RigError` where no lens is so."""
    model = fields.take('distortion_model', str)
    if model != 'plumb_bob':
        raise RigError(f'{block}.distortion_model is {model!r}: only plumb_bob is known')
    lens = Lens(
        fields.take('image_width', Pixels),
        fields.take('image_height', Pixels),
        fields.block('camera_matrix').as_matrix(3, 3),
        fields.block('distortion_coefficients').as_matrix(1, 5)[0],
    )
    matrix = lens.camera_matrix
    if (matrix[[0, 1], [0, 1]] <= 0).any() or (
        matrix[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]] != _REST
    ).any():
        raise RigError(
            f'{block}.camera_matrix is not [f_x, 0, c_x, 0, f_y, c_y, 0, 0, 1] with positive '
            'focal lengths: calibrate again'
        )
    _refuse_folding(lens, block)
    return lens


def _refuse_folding(lens: Lens, block: str) -> None:
    """Refuse a distortion that maps two rays to one pixel inside the image."""
    pixels = lens.sample_grid(33, 33)
    with np.errstate(all='ignore'):
        rays = lens.rays(pixels)
        _, jacobian = lens._distort(rays[..., :2])
        error = np.abs(lens.project(rays) - pixels).max()
        one_to_one = error < 1e-6 and (np.linalg.det(jacobian) > 0).all()
    if not one_to_one:
        raise RigError(
            f'{block}.distortion_coefficients fold the image over itself inside its '
            f'{lens.width}x{lens.height} pixels: calibrate again'
        )
