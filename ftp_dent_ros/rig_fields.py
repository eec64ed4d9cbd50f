"""The fields of ``rig.yaml``: lenses, matrices and lists of numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import RigError
from ftp_dent_ros.lens import Lens

# A level of 12 bits each.
_MOST_RESPONSE = 4096


def lens_fields(lens: Lens) -> dict[str, Any]:
    """A lens as fields of a block."""
    return {
        'image_width': lens.width,
        'image_height': lens.height,
        'camera_matrix': {'rows': 3, 'cols': 3, 'data': lens.camera_matrix.ravel().tolist()},
        'distortion_model': 'plumb_bob',
        'distortion_coefficients': {'rows': 1, 'cols': 5, 'data': lens.distortion.tolist()},
    }


def lens_from(data: dict[str, Any], block: str) -> Lens:
    """The lens of a block; raises `RigError`, as all here, naming the field."""
    model = _field(data, block, 'distortion_model')
    if model != 'plumb_bob':
        raise RigError(f'{block}.distortion_model is {model!r}: only plumb_bob is known')
    matrix = matrix_of(data, block, 'camera_matrix', (3, 3))
    if (matrix[[0, 1], [0, 1]] <= 0).any():
        raise RigError(f'{block}.camera_matrix has no positive focal lengths: calibrate again')
    if matrix[0, 1] != 0 or matrix[1, 0] != 0 or matrix[2].tolist() != [0, 0, 1]:
        raise RigError(
            f'{block}.camera_matrix is not [f_x, 0, c_x, 0, f_y, c_y, 0, 0, 1]: calibrate again'
        )
    lens = Lens(
        _size(data, block, 'image_width'),
        _size(data, block, 'image_height'),
        matrix,
        matrix_of(data, block, 'distortion_coefficients', (1, 5))[0],
    )
    _refuse_folding(lens, block)
    return lens


def response_from(data: dict[str, Any]) -> NDArray[np.float64] | None:
    """The camera's response, or None if none is given."""
    values = data['camera'].get('response')
    if values is None:
        return None
    count = len(values) if isinstance(values, list) else 0
    if not 2 <= count <= _MOST_RESPONSE:
        raise RigError(
            f'camera.response is not a list of 2 to {_MOST_RESPONSE} numbers: give the light of '
            'evenly spaced levels, from 0 to 1, or remove it'
        )
    light = numbers_of(data, 'camera', 'response', count)
    if light[0] != 0 or light[-1] != 1 or (np.diff(light) <= 0).any():
        raise RigError(
            'camera.response does not rise from 0 to 1 all the way: give the light of evenly '
            'spaced levels'
        )
    return light


def _refuse_folding(lens: Lens, block: str) -> None:
    """Refuse a distortion that maps two rays to one pixel inside the image."""
    edge = np.linspace(0, 1, 33)
    u, v = np.meshgrid(edge * (lens.width - 1), edge * (lens.height - 1))
    pixels = np.stack([u, v], axis=-1)
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


def _field(data: dict[str, Any], block: str, name: str) -> Any:
    fields = data.get(block)
    if not isinstance(fields, dict):
        raise RigError(f'the block {block} is missing: add it')
    if name not in fields:
        raise RigError(f'{block}.{name} is missing: add it')
    return fields[name]


def _size(data: dict[str, Any], block: str, name: str) -> int:
    value = _field(data, block, name)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 < value <= 65536:
        raise RigError(f'{block}.{name} is {value!r}, not a number of pixels: correct it')
    return value


def numbers_of(
    data: dict[str, Any], block: str, name: str, count: int, values: Any = None
) -> NDArray[np.float64]:
    """A list of so many finite numbers."""
    values = _field(data, block, name) if values is None else values
    if not isinstance(values, list) or len(values) != count:
        raise RigError(f'{block}.{name} is not a list of {count} numbers: correct it')
    for value in values:
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not number or not math.isfinite(value):
            raise RigError(f'{block}.{name} holds {value!r}, not a finite number: correct it')
    return np.array(values, float)


def matrix_of(
    data: dict[str, Any], block: str, name: str, shape: tuple[int, int]
) -> NDArray[np.float64]:
    """A matrix of that shape."""
    matrix = _field(data, block, name)
    if not isinstance(matrix, dict) or (matrix.get('rows'), matrix.get('cols')) != shape:
        raise RigError(
            f'{block}.{name} is not a matrix with rows: {shape[0]}, cols: {shape[1]}: correct it'
        )
    values = numbers_of(data, block, f'{name}.data', shape[0] * shape[1], matrix.get('data', ()))
    return values.reshape(shape)
