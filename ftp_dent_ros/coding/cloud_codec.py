"""A cloud in a fiftieth of its size: its depth along known rays, as fine as its own noise.

Layout, little endian: ``FDC`` and the version (1 byte); the header's size (2 bytes) and the
header (deflated JSON); the masks and planes of bytes that it lists; CRC-32 of all before.

The organised grid of a camera needs no x and y: they are depth times ray, and the rays are the
lens's. Depth is quantised in equal steps of its inverse (disparity, in which a projector's noise
is even), differenced and deflated. The same bytes give the same cloud on every machine: whole
numbers, and single IEEE operations elsewhere.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.planes import Mask, pack, unpack
from ftp_dent_ros.coding.quantising import Scale, quantise, restore
from ftp_dent_ros.coding.steps import PART, inverse_step, is_on_rays, linear_step
from ftp_dent_ros.coding.view import View
from ftp_dent_ros.errors import CodecError

VERSION = 1
MAGIC = b'FDC'
# Grey levels of the modulation.
_INTENSITY_STEP = 1.0
_MOST_POINTS = 1 << 24
_LARGEST_HEADER = 1 << 14
_START = struct.Struct('<3sBH')
_END = struct.Struct('<I')


def encode(cloud: Cloud, view: View | None = None, part: float = PART) -> bytes:
    """Cloud as bytes.

    Parameters
    ----------
    cloud : Cloud
    view : View, optional
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
        writer.add('z', depth, valid, Scale.INVERSE, step)
    else:
        view = None
        metres = linear_step(cloud.points, cloud.sigma, valid, part)
        for axis, name in enumerate('xyz'):
            writer.add(name, cloud.points[..., axis], valid, Scale.LINEAR, metres)
    lit = np.isfinite(cloud.intensity) & (cloud.intensity != 0)
    if lit.any():
        writer.add('intensity', cloud.intensity, lit, Scale.LINEAR, _INTENSITY_STEP)
    for name in ('sigma', 'resolution'):
        values = getattr(cloud, name)
        known = np.isfinite(values) & (values > 0)
        if known.any():
            writer.add(name, values, known, Scale.LOGARITHM)
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


def thinned(cloud: Cloud, view: View | None, columns: int) -> tuple[Cloud, View | None]:
    """Every n-th point of a cloud, for a preview of at most so many columns."""
    every = max(1, math.ceil(cloud.intensity.shape[1] / columns))
    points = np.ascontiguousarray(cloud.points[::every, ::every])
    rest = (
        getattr(cloud, name)[::every, ::every] for name in ('intensity', 'sigma', 'resolution')
    )
    few = View(view.lens, view.stride * every) if view else None
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
        scale: Scale,
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

    def finish(self, rows: int, columns: int, view: View | None) -> bytes:
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
        values[name] = restore(steps, Scale(field['scale']), float(field['step']))
    valid = within['z']
    if header['view'] is None:
        x, y, z = (values[axis] for axis in 'xyz')
    else:
        view = View.from_numbers(header['view'])
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
