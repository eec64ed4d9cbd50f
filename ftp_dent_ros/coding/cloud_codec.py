"""Clouds in few bytes."""

from __future__ import annotations

import json
import math
import struct
import zlib
from dataclasses import dataclass
from enum import Enum
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.rig.rig import Lens

# Differences along the rows alone, or along both axes (left + above - left above).
ROWS, BOTH = 0, 1
# The residuals are noise without repetitions: runs and Huffman's code are what is to be had.
_LEVEL, _MEMORY = 1, 8
# Of the rows, to choose the prediction by.
_EVERY = 4

# Whole numbers beyond it are not differenced without loss of their sign.
_LARGEST = 2**29
# 2^(k/4), written out: powers are not the same on every machine.
_PARTS = 4
_POWERS = np.array([1.0, 1.189207115002721, 1.4142135623730951, 1.681792830507429])
# Halfway between them: the mantissas of float32 (23 bits) from which on the next one is nearer,
# those of 2^(1/8), 2^(3/8), 2^(5/8), 2^(7/8).
_NEXT = 759234, 2490071, 4548395, 6996167
_MANTISSA, _BITS, _BIAS = (1 << 23) - 1, 23, 127

# Of a point's stated uncertainty, for the step of its depth: the error is half a step at most, and
# what single precision rounds.
PART = 0.9
# 1/m, where no uncertainty is stated: 0.4 um at 0.6 m, 1.4 um at 1.2 m, which is 0.0003 rad of
# the shipped rig's fringes, half of the noise of its best photographs.
STEP_UNKNOWN = 1e-6
# 1/m: at 1 m what a float32 resolves.
_FINEST = 1e-7
# Points off the lens's rays by more than this part of their depth are not its camera's.
_OFF_THE_RAY = 1e-6

VERSION = 1
MAGIC = b'FDC'
# Grey levels of the modulation.
_INTENSITY_STEP = 1.0
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
        width, height, f_x, f_y, c_x, c_y, *distortion, stride = map(float, numbers)
        given = np.array([width, height, f_x, f_y, c_x, c_y, *distortion, stride])
        if len(given) != 12 or not np.isfinite(given).all() or not given[:4].min() > 0:
            raise ValueError('no numbers of a view')
        matrix = np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]])
        if stride < 1:
            raise ValueError('no stride')
        return RayGrid(Lens(int(width), int(height), matrix, np.array(distortion)), int(stride))

    def rays(self) -> NDArray[np.float32]:
        """x/z and y/z of each point, shape (2, rows, columns)."""
        return _rays(tuple(self.numbers()))

    def lengths(self) -> NDArray[np.float32]:
        """Distance from the camera over the depth, shape (rows, columns)."""
        return _lengths(tuple(self.numbers()))


@lru_cache(maxsize=4)
def _rays(numbers: tuple[float, ...]) -> NDArray[np.float32]:
    view = RayGrid.from_numbers(numbers)
    with np.errstate(all='ignore'):
        rays = view.lens.rays(view.lens.pixel_grid(view.stride))[..., :2]
    return np.ascontiguousarray(np.moveaxis(rays, 2, 0), np.float32)


@lru_cache(maxsize=4)
def _lengths(numbers: tuple[float, ...]) -> NDArray[np.float32]:
    x, y = _rays(numbers)
    return np.sqrt(1 + x * x + y * y)


@dataclass(frozen=True, eq=False)
class Mask:
    """Where a grid has values.

    Attributes
    ----------
    where : ndarray, shape (rows, columns), bool
    """

    where: NDArray[np.bool_]

    @cached_property
    def packed(self) -> bytes:
        """Deflated outline: each row's change from the one above."""
        bits = np.packbits(self.where, axis=1)
        bits[1:] ^= bits[:-1].copy()
        return zlib.compress(bits.tobytes(), 6)

    @cached_property
    def _neighbours(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Flat indices of the holes, and of the last value before each in its row, or the first.

        Holes of a row without any value are left out.
        """
        holes = np.flatnonzero(~self.where)
        values = np.flatnonzero(self.where)
        if not len(values):
            return values, values
        row = holes // self.where.shape[1]
        # As many values lie before a hole as there are places less the holes before it.
        count = holes - np.arange(len(holes))
        before = values[np.maximum(count - 1, 0)]
        after = values[np.minimum(count, len(values) - 1)]
        has_before = (count > 0) & (before // self.where.shape[1] == row)
        chosen = np.where(has_before, before, after)
        is_there = chosen // self.where.shape[1] == row
        return holes[is_there], chosen[is_there]

    def fill(self, values: NDArray[np.int32]) -> NDArray[np.int32]:
        """Put what is easily predicted into a grid's holes, in place; the grid."""
        holes, neighbours = self._neighbours
        flat = values.reshape(-1)
        flat[holes] = flat[neighbours]
        return values

    @staticmethod
    def unpack(data: bytes, shape: tuple[int, int]) -> Mask:
        """Mask of its `packed`; raises `CodecError` if the data are damaged."""
        rows, columns = shape
        width = (columns + 7) // 8
        bits = np.frombuffer(inflate(data, rows * width), np.uint8).reshape(rows, width)
        bits = np.bitwise_xor.accumulate(bits, axis=0)
        return Mask(np.unpackbits(bits, axis=1, count=columns).view(bool))


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
    few = slice(None, None, _EVERY)
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
        plane = (folded >> (8 * index)).astype(np.uint8)
        first = int(plane.flat[0]) if plane.size else 0
        # The first residual is the first value itself, beside which all others are small.
        is_empty = np.count_nonzero(plane) == bool(first)
        planes.append(_alone(first, plane.size) if is_empty else _deflated(plane.data))
    return planes


@lru_cache(maxsize=16)
def _alone(first: int, size: int) -> bytes:
    """Deflated plane of one byte and zeros."""
    return _deflated(bytes([first]) + bytes(size - 1) if size else b'')


def _deflated(plane: bytes | memoryview) -> bytes:
    writer = zlib.compressobj(_LEVEL, zlib.DEFLATED, zlib.MAX_WBITS, _MEMORY, zlib.Z_RLE)
    return writer.compress(plane) + writer.flush()


class StepScale(str, Enum):
    """What has equal steps; those of the logarithm are a quarter of an octave: 9 % off at most."""

    LINEAR = 'linear'
    INVERSE = 'inverse'
    LOGARITHM = 'logarithm'


def quantise(
    values: NDArray[np.float32], mask: Mask, scale: StepScale, step: float
) -> NDArray[np.int32]:
    """Nearest whole numbers of steps; where the mask is false, what is easily predicted.

    Parameters
    ----------
    values : ndarray, shape (rows, columns)
        Finite where the mask is true; with `StepScale.INVERSE` not 0, with `StepScale.LOGARITHM`
        positive (and below 1e-38 taken for that).
    mask : Mask
    scale : StepScale
    step : float
        In the unit of the value or of its inverse; of no meaning to `StepScale.LOGARITHM`.

    Raises
    ------
    CodecError
        A step is too small for the values.
    """
    there = np.where(mask.where, values, np.float32(1))
    if scale is StepScale.LOGARITHM:
        return mask.fill(_quarters(there))
    if scale is StepScale.INVERSE:
        steps = np.reciprocal(there, dtype=np.float64)
        steps /= step
    else:
        steps = np.divide(there, step, dtype=np.float64)
    np.rint(steps, out=steps)
    # All places are of values, or of 1.
    if not (steps.max(initial=0.0) < _LARGEST and steps.min(initial=0.0) > -_LARGEST):
        raise CodecError(f'a step of {step:g} is too small for the values: choose a larger one')
    return mask.fill(steps.astype(np.int32))


def _quarters(values: NDArray[np.float32]) -> NDArray[np.int32]:
    """Four times the logarithm to base 2, rounded, out of the numbers' own bits."""
    bits = np.ascontiguousarray(values, np.float32).view(np.int32)
    mantissa = bits & np.int32(_MANTISSA)
    parts = np.zeros(bits.shape, np.uint8)
    for least in _NEXT:
        parts += mantissa >= least
    return ((bits >> _BITS) - _BIAS) * _PARTS + parts


def restore(steps: NDArray[np.int32], scale: StepScale, step: float) -> NDArray[np.float32]:
    """Values of `quantise`'s whole numbers, shape (rows, columns); inf for an inverse of 0."""
    if scale is StepScale.LOGARITHM:
        power = _POWERS.astype(np.float32)[steps & (_PARTS - 1)]
        return np.ldexp(power, np.clip(steps >> 2, -120, 120))
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
    if view.shape != valid.shape:
        return False
    count = np.count_nonzero(valid)
    if np.count_nonzero((depth > 0) & valid) != count:
        return False
    with np.errstate(invalid='ignore', over='ignore'):
        bound = depth * np.float32(_OFF_THE_RAY)
        for axis, ray in enumerate(view.rays()):
            off = points[..., axis].copy()
            off -= ray * depth
            np.abs(off, out=off)
            if np.count_nonzero((off <= bound) & valid) != count:
                return False
    return True


def inverse_step(
    depth: NDArray[np.float32],
    sigma: NDArray[np.float32],
    valid: NDArray[np.bool_],
    view: RayGrid,
    part: float,
) -> float:
    """Step of 1/z, by the point whose uncertainty is the smallest in it.

    A change of 1/z by d moves a point p along its ray by ``|p| z d``.
    """
    known = valid & (sigma > 0)
    if not known.any():
        return STEP_UNKNOWN * part
    with np.errstate(all='ignore'):
        noise = sigma / (view.lengths() * depth * depth)
    return max(float(noise.min(where=known, initial=np.inf)) * part, _FINEST)


def linear_step(
    points: NDArray[np.float32],
    sigma: NDArray[np.float32],
    valid: NDArray[np.bool_],
    part: float,
) -> float:
    """Step of x, y and z, metres."""
    known = valid & (sigma > 0)
    if known.any():
        return max(float(sigma[known].min()) * part / math.sqrt(3), _FINEST)
    return STEP_UNKNOWN * part


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
    writer = _Writer()
    depth = np.ascontiguousarray(cloud.points[..., 2])
    valid: NDArray[np.bool_] = np.isfinite(depth)
    if view is not None and is_on_rays(cloud.points, depth, valid, view):
        step = inverse_step(depth, cloud.sigma, valid, view, part)
        writer.add('z', depth, valid, StepScale.INVERSE, step)
    else:
        view = None
        metres = linear_step(cloud.points, cloud.sigma, valid, part)
        for axis, name in enumerate('xyz'):
            writer.add(name, cloud.points[..., axis], valid, StepScale.LINEAR, metres)
    lit = np.isfinite(cloud.intensity) & (cloud.intensity != 0)
    if lit.any():
        writer.add('intensity', cloud.intensity, lit, StepScale.LINEAR, _INTENSITY_STEP)
    for name in ('sigma', 'resolution'):
        values = getattr(cloud, name)
        known = np.isfinite(values) & (values > 0)
        if known.any():
            writer.add(name, values, known, StepScale.LOGARITHM)
    return writer.finish(rows, columns, view)


def decode(data: bytes | memoryview) -> Cloud:
    """Cloud of `encode`'s bytes.

    Raises
    ------
    CodecError
        They are damaged, of another version, or no cloud.
    """
    header, body = _opened(bytes(data))
    try:
        return _decoded(header, body)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError, AttributeError):
        raise CodecError('the header of an encoded cloud is malformed: ask for it again') from None


def thinned(cloud: Cloud, view: RayGrid | None, columns: int) -> tuple[Cloud, RayGrid | None]:
    """Every n-th point of a cloud, for a preview of at most so many columns."""
    every = max(1, math.ceil(cloud.intensity.shape[1] / columns))
    points = np.ascontiguousarray(cloud.points[::every, ::every])
    rest = (
        getattr(cloud, name)[::every, ::every] for name in ('intensity', 'sigma', 'resolution')
    )
    few = RayGrid(view.lens, view.stride * every) if view else None
    return Cloud(points, *rest), few


class _Writer:
    """Masks and planes so far; a mask that comes again is written once."""

    def __init__(self) -> None:
        self._fields: list[dict[str, Any]] = []
        self._masks: list[Mask] = []
        self._body: list[bytes] = []

    def add(
        self,
        name: str,
        values: NDArray[np.float32],
        where: NDArray[np.bool_],
        scale: StepScale,
        step: float = 0.0,
    ) -> None:
        index = self._mask(where)
        prediction, planes = pack(quantise(values, self._masks[index], scale, step))
        self._body += planes
        self._fields.append(
            {
                'name': name,
                'scale': scale.value,
                'step': step,
                'mask': index,
                'prediction': prediction,
                'planes': [len(plane) for plane in planes],
            }
        )

    def _mask(self, where: NDArray[np.bool_]) -> int:
        for index, mask in enumerate(self._masks):
            if np.array_equal(mask.where, where):
                return index
        self._masks.append(Mask(where))
        return len(self._masks) - 1

    def finish(self, rows: int, columns: int, view: RayGrid | None) -> bytes:
        header = {
            'rows': rows,
            'columns': columns,
            'view': view.numbers() if view else None,
            'masks': [len(mask.packed) for mask in self._masks],
            'fields': self._fields,
        }
        text = zlib.compress(json.dumps(header, separators=(',', ':')).encode('ascii'))
        masks = [mask.packed for mask in self._masks]
        whole = b''.join([_START.pack(MAGIC, VERSION, len(text)), text, *masks, *self._body])
        return whole + _END.pack(zlib.crc32(whole))


def _opened(data: bytes) -> tuple[dict[str, Any], bytes]:
    """Header and body, once the checksum is right."""
    if len(data) < _START.size + _END.size or data[:3] != MAGIC:
        raise CodecError('this is no encoded cloud: give what the encoder wrote')
    _, version, size = _START.unpack_from(data)
    if version != VERSION:
        raise CodecError(
            f'the cloud is of version {version}, this program knows {VERSION}: use the same '
            'version at both ends'
        )
    (checksum,) = _END.unpack(data[-_END.size :])
    if zlib.crc32(data[: -_END.size]) != checksum:
        raise CodecError('the checksum of an encoded cloud is wrong: ask for it again')
    reader = zlib.decompressobj()
    try:
        text = reader.decompress(data[_START.size : _START.size + size], _LARGEST_HEADER)
        header = json.loads(text)
    except (zlib.error, ValueError, RecursionError):
        raise CodecError('the header of an encoded cloud is malformed: ask for it again') from None
    if not isinstance(header, dict):
        raise CodecError('the header of an encoded cloud is malformed: ask for it again')
    return header, data[_START.size + size : -_END.size]


def _decoded(header: dict[str, Any], body: bytes) -> Cloud:
    shape = int(header['rows']), int(header['columns'])
    if min(shape) < 0 or shape[0] * shape[1] > _MOST_POINTS or len(header['fields']) > 16:
        raise CodecError('an encoded cloud claims to be too large: it is refused')
    at = 0

    def take(size: int) -> bytes:
        nonlocal at
        if not 0 <= size <= len(body) - at:
            raise CodecError('an encoded cloud is cut short: ask for it again')
        at += size
        return body[at - size : at]

    if len(header['masks']) > 16:
        raise CodecError('an encoded cloud claims to be too large: it is refused')
    masks = [Mask.unpack(take(size), shape).where for size in header['masks']]
    values: dict[str, NDArray[np.float32]] = {}
    within: dict[str, NDArray[np.bool_]] = {}
    for field in header['fields']:
        if len(field['planes']) > 4:
            raise CodecError('an encoded cloud claims to be too large: it is refused')
        steps = unpack(field['prediction'], [take(size) for size in field['planes']], shape)
        name = field['name']
        within[name] = masks[field['mask']]
        values[name] = restore(steps, StepScale(field['scale']), float(field['step']))
    valid = within['z']
    if header['view'] is None:
        x, y, z = (values[axis] for axis in 'xyz')
    else:
        view = RayGrid.from_numbers(header['view'])
        if view.shape != shape:
            raise ValueError
        rays = view.rays()
        z = values['z']
        with np.errstate(invalid='ignore', over='ignore'):
            x, y = rays[0] * z, rays[1] * z
    with np.errstate(invalid='ignore', over='ignore'):
        if not (np.isfinite(x + y + z) | ~valid).all():
            raise CodecError('an encoded cloud holds points at infinity: it is refused')
    points = np.empty((*shape, 3), np.float32)
    for axis, plane in enumerate((x, y, z)):
        plane[~valid] = np.nan
        points[..., axis] = plane
    rest: dict[str, Any] = {}
    for name, nothing in (('intensity', 0.0), ('sigma', np.nan), ('resolution', np.nan)):
        rest[name] = values.get(name, np.full(shape, nothing, np.float32))
        if name in values:
            rest[name][~within[name]] = nothing
    return Cloud(points, **rest)
