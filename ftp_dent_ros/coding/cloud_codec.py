"""Clouds in few bytes."""

from __future__ import annotations

import io
import json
import math
import struct
import zlib
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import FIELDS, Cloud
from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.rig.rig import Lens

# Differences along the rows alone, or along both axes (left + above - left above).
ROWS, BOTH = 0, 1

# Whole numbers beyond it are not differenced without loss of their sign.
_LARGEST = 2**29
# 2^(k/4), written out: powers are not the same on every machine.
_POWERS = np.array([1.0, 1.189207115002721, 1.4142135623730951, 1.681792830507429], np.float32)

# Of a point's stated uncertainty, for the step of its depth: the error is half a step at most, and
# what single precision rounds.
PART = 0.9
# 1/m, where no uncertainty is stated: 0.4 um at 0.6 m, 1.4 um at 1.2 m, which is 0.0003 rad of
# the shipped rig's fringes, half of the noise of its best photographs.
STEP_UNKNOWN = 1e-6
# 1/m: at 1 m what a float32 resolves.
_FINEST = 1e-7

VERSION = 1
MAGIC = b'FDC'
_MOST_POINTS = 1 << 24
_LARGEST_HEADER = 1 << 14
_START = struct.Struct('<3sBH')
_END = struct.Struct('<I')


@dataclass(frozen=True)
class RayGrid:
    """Whose rays an organised cloud lies on.

    Attributes
    ----------
    lens : Lens
        Of the camera whose frame the cloud is in.
    stride : int
        The cloud has a point at every so many pixels along rows and columns.
    """

    lens: Lens
    stride: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the cloud."""
        return -(-self.lens.height // self.stride), -(-self.lens.width // self.stride)

    @staticmethod
    def of(lens: Lens, rows: int, columns: int) -> RayGrid | None:
        """RayGrid of a cloud of that size, or None if no stride gives it."""
        stride = max(1, round(lens.width / max(columns, 1)))
        view = RayGrid(lens, stride)
        return view if view.shape == (rows, columns) else None

    def numbers(self) -> list[float]:
        """Width, height, f_x, f_y, c_x, c_y, the five of the distortion, stride."""
        matrix = self.lens.camera_matrix
        return [
            *(self.lens.width, self.lens.height),
            *(float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))),
            *map(float, self.lens.distortion),
            self.stride,
        ]

    @staticmethod
    def from_numbers(numbers: Any) -> RayGrid:
        """RayGrid of its `numbers`; raises `ValueError` or `TypeError` if they are none."""
        given = np.array(numbers, float)
        possible = given.shape == (12,) and np.isfinite(given).all()
        if not possible or given[:4].min() <= 0 or given[11] < 1:
            raise ValueError('no numbers of a view')
        width, height, f_x, f_y, c_x, c_y = given[:6]
        matrix = np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]])
        return RayGrid(Lens(int(width), int(height), matrix, given[6:11]), int(given[11]))

    def rays(self) -> NDArray[np.float32]:
        """x/z and y/z of each point, shape (2, rows, columns)."""
        return _rays(tuple(self.numbers()))


@lru_cache(maxsize=4)
def _rays(numbers: tuple[float, ...]) -> NDArray[np.float32]:
    view = RayGrid.from_numbers(numbers)
    with np.errstate(all='ignore'):
        rays = view.lens.rays(view.lens.pixel_grid(view.stride))[..., :2]
    return np.ascontiguousarray(np.moveaxis(rays, 2, 0), np.float32)


def _outline(where: NDArray[np.bool_]) -> bytes:
    """A mask, deflated: each row's change from the one above."""
    bits = np.packbits(where, axis=1)
    bits[1:] ^= bits[:-1].copy()
    return zlib.compress(bits.tobytes(), 6)


def _mask(outline: bytes, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask of its `_outline`; raises `CodecError` if the data are damaged."""
    rows, columns = shape
    width = (columns + 7) // 8
    bits = np.frombuffer(inflate(outline, rows * width), np.uint8).reshape(rows, width)
    bits = np.bitwise_xor.accumulate(bits, axis=0)
    return np.unpackbits(bits, axis=1, count=columns).view(bool)


def _neighbours(where: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Flat indices of a mask's holes, and of the last value before each in its row, or the first.

    In a row without any value that is the row's first hole. A hole that repeats its neighbour is
    easily predicted.
    """
    rows, columns = where.shape
    last = np.maximum.accumulate(np.where(where, np.arange(columns), 0), axis=1)
    known = np.maximum(last, where.argmax(axis=1)[:, None])
    known += columns * np.arange(rows)[:, None]
    return np.flatnonzero(~where), known[~where]


def pack(values: NDArray[np.int32]) -> tuple[int, list[bytes]]:
    """Deflated residuals of a grid, under the prediction that leaves the smaller ones.

    Parameters
    ----------
    values : ndarray, shape (rows, columns), int32

    Returns
    -------
    prediction : int
        `ROWS` or `BOTH`.
    planes : list of bytes
        The residuals' lowest bytes, the next ones, and so on; as many as are needed.
    """
    along = values.copy()
    along[:, 1:] -= values[:, :-1]
    across = along.copy()
    across[1:] -= along[:-1]
    # Some of the rows tell.
    few = slice(None, None, 4)
    if np.abs(across[few]).sum(dtype=float) < np.abs(along[few]).sum(dtype=float):
        return BOTH, _planes(across)
    return ROWS, _planes(along)


def unpack(prediction: int, planes: list[bytes], shape: tuple[int, int]) -> NDArray[np.int32]:
    """Grid that `pack` was given.

    Raises
    ------
    CodecError
        A plane is damaged or of another size.
    """
    if prediction not in (ROWS, BOTH):
        raise CodecError(f'an unknown prediction ({prediction}): use the version that wrote it')
    size = shape[0] * shape[1]
    residuals = np.zeros(shape, np.uint32)
    for index, plane in enumerate(planes):
        part = np.frombuffer(inflate(plane, size), np.uint8).reshape(shape)
        residuals |= np.left_shift(part, 8 * index, dtype=np.uint32)
    signed = (residuals >> 1) ^ (np.uint32(0) - (residuals & 1))
    np.cumsum(signed, axis=1, dtype=np.uint32, out=signed)
    if prediction == BOTH:
        for row in range(1, shape[0]):  # in the cache; cumsum along the columns is not
            signed[row] += signed[row - 1]
    return signed.view(np.int32)


def inflate(data: bytes, size: int) -> bytes:
    """Exactly `size` bytes of deflated data, and never more memory than that.

    Raises
    ------
    CodecError
        The data are damaged, or there are more or fewer.
    """
    reader = zlib.decompressobj()
    try:
        whole = reader.decompress(data, max(size, 1))
        more = b'' if reader.eof else reader.decompress(reader.unconsumed_tail, 1)
    except zlib.error as reason:
        raise CodecError(f'deflated data are damaged ({reason}): ask for them again') from None
    if len(whole) != size or more or not reader.eof:
        raise CodecError(f'deflated data are not of {size} bytes: ask for them again')
    return whole


def _planes(residuals: NDArray[np.int32]) -> list[bytes]:
    # Small ones of either sign become small whole numbers: 0, -1, 1, -2 are 0, 1, 2, 3.
    folded = ((residuals << 1) ^ (residuals >> 31)).view(np.uint32)
    count = max(1, (int(folded.max(initial=0)).bit_length() + 7) // 8)
    planes = []
    for index in range(count):
        # Residuals are noise without repetitions: runs and Huffman's code are what is to be had.
        writer = zlib.compressobj(1, zlib.DEFLATED, zlib.MAX_WBITS, 8, zlib.Z_RLE)
        plane = (folded >> (8 * index)).astype(np.uint8)
        planes.append(writer.compress(plane.data) + writer.flush())
    return planes


class StepScale(str, Enum):
    """What has equal steps; those of the logarithm are a quarter of an octave: 9 % off at most."""

    LINEAR = 'linear'
    INVERSE = 'inverse'
    LOGARITHM = 'logarithm'


def quantise(
    values: NDArray[np.float32], where: NDArray[np.bool_], scale: StepScale, step: float
) -> NDArray[np.int32]:
    """Nearest whole numbers of steps; where the mask is false, of no meaning.

    Parameters
    ----------
    values : ndarray, shape (rows, columns)
        Finite where the mask is true; with `StepScale.INVERSE` not 0, with `StepScale.LOGARITHM`
        positive (and below 1e-38 taken for that).
    where : ndarray, shape (rows, columns), bool
    scale : StepScale
    step : float
        In the unit of the value or of its inverse; of no meaning to `StepScale.LOGARITHM`.

    Raises
    ------
    CodecError
        A step is too small for the values.
    """
    there = np.where(where, values, np.float32(1))
    if scale is StepScale.LOGARITHM:
        steps = len(_POWERS) * np.log2(there)
    elif scale is StepScale.INVERSE:
        steps = np.reciprocal(there, dtype=np.float64)
        steps /= step
    else:
        steps = np.divide(there, step, dtype=np.float64)
    np.rint(steps, out=steps)
    # All places are of values, or of 1.
    if not (steps.max(initial=0.0) < _LARGEST and steps.min(initial=0.0) > -_LARGEST):
        raise CodecError(f'a step of {step:g} is too small for the values: choose a larger one')
    return steps.astype(np.int32)


def restore(steps: NDArray[np.int32], scale: StepScale, step: float) -> NDArray[np.float32]:
    """Values of `quantise`'s whole numbers, shape (rows, columns); inf for an inverse of 0."""
    if scale is StepScale.LOGARITHM:
        octaves, parts = np.divmod(steps, len(_POWERS))
        return np.ldexp(_POWERS[parts], np.clip(octaves, -120, 120))
    with np.errstate(divide='ignore', over='ignore'):
        values = steps * np.float64(step)
        if scale is StepScale.INVERSE:
            np.reciprocal(values, out=values)
        return values.astype(np.float32)


def is_on_rays(
    points: NDArray[np.float32],
    depth: NDArray[np.float32],
    valid: NDArray[np.bool_],
    view: RayGrid,
) -> bool:
    """Whether all valid points (rows, columns, 3) lie on the view's rays, ahead of the camera."""
    fits = depth > 0
    with np.errstate(invalid='ignore', over='ignore'):
        # Farther off, as a part of their depth, points are not of this camera.
        bound = depth * np.float32(1e-6)
        for axis, ray in enumerate(view.rays()):
            fits &= np.abs(points[..., axis] - ray * depth) <= bound
    return bool((fits | ~valid).all())


def _step(
    noise: NDArray[Any], sigma: NDArray[np.float32], valid: NDArray[np.bool_], part: float
) -> float:
    """Step of what has a noise, by the point that knows it best; of no point, the one unknown."""
    known = valid & (sigma > 0)
    if not known.any():
        return STEP_UNKNOWN * part
    return max(float(noise.min(where=known, initial=np.inf)) * part, _FINEST)


def encode(cloud: Cloud, view: RayGrid | None = None, part: float = PART) -> bytes:
    """Cloud as bytes.

    Parameters
    ----------
    cloud : Cloud
    view : RayGrid, optional
        If the cloud is in its camera's frame, on its rays. Otherwise, or without it, x, y and z
        are quantised alike, at two to three times the size.
    part : float
        Step of the depth, of which the error is half at most, over the smallest of the points'
        uncertainties; over `STEP_UNKNOWN` where none is stated.

    Raises
    ------
    CodecError
        There are too many points, or their values do not fit.
    """
    rows, columns = cloud.intensity.shape
    if rows * columns > _MOST_POINTS:
        raise CodecError(f'a cloud of {columns}x{rows} points is too large: use a larger stride')
    depth = np.ascontiguousarray(cloud.points[..., 2])
    valid: NDArray[np.bool_] = np.isfinite(depth)
    sigma = cloud.sigma
    if view is not None and is_on_rays(cloud.points, depth, valid, view):
        x, y = view.rays()
        with np.errstate(all='ignore'):
            # A change of 1/z by d moves a point p along its ray by |p| z d.
            noise = sigma / (np.sqrt(1 + x * x + y * y) * depth * depth)
        given = [('z', depth, valid, StepScale.INVERSE, _step(noise, sigma, valid, part))]
    else:
        view = None
        step = _step(np.divide(sigma, math.sqrt(3), dtype=float), sigma, valid, part)
        planes = zip('xyz', np.moveaxis(cloud.points, 2, 0), strict=True)
        given = [(name, plane, valid, StepScale.LINEAR, step) for name, plane in planes]
    lit = np.isfinite(cloud.intensity) & (cloud.intensity != 0)
    rest = [('intensity', cloud.intensity, lit, StepScale.LINEAR, 1.0)]
    known = np.isfinite(cloud.raw) & (cloud.noise > 0)
    step = _step(cloud.noise, cloud.noise, known, part)
    rest.append(('raw', cloud.raw, known, StepScale.LINEAR, step))
    for name in ('sigma', 'resolution', 'noise'):
        values = getattr(cloud, name)
        rest.append((name, values, np.isfinite(values) & (values > 0), StepScale.LOGARITHM, 0.0))
    given += [field for field in rest if field[2].any()]
    masks: list[NDArray[np.bool_]] = []
    holes: list[tuple[NDArray[np.intp], NDArray[np.intp]]] = []
    fields: list[dict[str, Any]] = []
    body: list[bytes] = []
    for name, values, where, scale, step in given:
        # A mask that comes again is written once.
        same = (number for number, mask in enumerate(masks) if np.array_equal(mask, where))
        number = next(same, len(masks))
        if number == len(masks):
            masks.append(where)
            holes.append(_neighbours(where))
        steps = quantise(values, where, scale, step)
        empty, neighbours = holes[number]
        steps.flat[empty] = steps.flat[neighbours]
        prediction, packed = pack(steps)
        body += packed
        fields.append(
            {
                'name': name,
                'scale': scale.value,
                'step': step,
                'mask': number,
                'prediction': prediction,
                'planes': [len(plane) for plane in packed],
            }
        )
    outlines = [_outline(mask) for mask in masks]
    header = {
        'rows': rows,
        'columns': columns,
        'view': view.numbers() if view else None,
        'masks': [len(outline) for outline in outlines],
        'fields': fields,
    }
    text = zlib.compress(json.dumps(header, separators=(',', ':')).encode('ascii'))
    whole = b''.join([_START.pack(MAGIC, VERSION, len(text)), text, *outlines, *body])
    return whole + _END.pack(zlib.crc32(whole))


def decode(data: bytes | memoryview) -> Cloud:
    """Cloud of `encode`'s bytes.

    Raises
    ------
    CodecError
        They are damaged, of another version, or no cloud.
    """
    data = bytes(data)
    start, end = _START.size, len(data) - _END.size
    if end < start or not data.startswith(MAGIC):
        raise CodecError('this is no encoded cloud: give what the encoder wrote')
    _, version, size = _START.unpack_from(data)
    if version != VERSION:
        raise CodecError(
            f'the cloud is of version {version}, this program knows {VERSION}: use the same '
            'version at both ends'
        )
    if data[end:] != _END.pack(zlib.crc32(data[:end])):
        raise CodecError('the checksum of an encoded cloud is wrong: ask for it again')
    try:
        text = zlib.decompressobj().decompress(data[start : start + size], _LARGEST_HEADER)
        return _decoded(json.loads(text), io.BytesIO(data[start + size : end]))
    except (zlib.error, LookupError, TypeError, ValueError, ArithmeticError, RecursionError):
        raise CodecError('the header of an encoded cloud is malformed: ask for it again') from None


def thinned(cloud: Cloud, view: RayGrid | None, columns: int) -> tuple[Cloud, RayGrid | None]:
    """Every n-th point of a cloud, for a preview of at most so many columns."""
    every = max(1, math.ceil(cloud.intensity.shape[1] / columns))
    points = np.ascontiguousarray(cloud.points[::every, ::every])
    rest = (getattr(cloud, name)[::every, ::every] for name in FIELDS[:3])
    few = RayGrid(view.lens, view.stride * every) if view else None
    return Cloud(points, *rest), few


def _decoded(header: dict[str, Any], body: io.BytesIO) -> Cloud:
    shape = int(header['rows']), int(header['columns'])
    fields = header['fields']
    many = max(len(header['masks']), len(fields)) > 16
    many = many or any(len(field['planes']) > 4 for field in fields)
    if min(shape) < 0 or shape[0] * shape[1] > _MOST_POINTS or many:
        raise CodecError('an encoded cloud claims to be too large: it is refused')
    masks = [_mask(body.read(size), shape) for size in header['masks']]
    values: dict[str, NDArray[np.float32]] = {}
    for field in fields:
        planes = [body.read(size) for size in field['planes']]
        steps = unpack(field['prediction'], planes, shape)
        found = restore(steps, StepScale(field['scale']), float(field['step']))
        found[~masks[field['mask']]] = 0.0 if field['name'] == 'intensity' else np.nan
        values[field['name']] = found
    if header['view'] is None:
        x, y, z = (values[axis] for axis in 'xyz')
    else:
        view = RayGrid.from_numbers(header['view'])
        if view.shape != shape:
            raise ValueError
        z = values['z']
        with np.errstate(invalid='ignore', over='ignore'):
            x, y = view.rays() * z
    with np.errstate(invalid='ignore', over='ignore'):
        if not (np.isfinite(x + y + z) | np.isnan(z)).all():
            raise CodecError('an encoded cloud holds points at infinity: it is refused')
    points = np.stack([x, y, z], axis=-1)
    dark, unknown = np.zeros(shape, np.float32), np.full(shape, np.nan, np.float32)
    rest = (values.get(name, unknown) for name in FIELDS[1:])
    return Cloud(points, values.get('intensity', dark), *rest)
