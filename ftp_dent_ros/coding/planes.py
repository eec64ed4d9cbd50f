"""Grids of whole numbers to bytes and back: differences, planes of bytes, deflate.

All is integer arithmetic modulo 2^32, so that every machine gives the same.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import CodecError

# Differences along the rows alone, or along both axes (left + above - left above).
ROWS, BOTH = 0, 1
# The residuals are noise without repetitions: runs and Huffman's code are what is to be had.
_LEVEL, _MEMORY = 1, 8
# Of the rows, to choose the prediction by.
_EVERY = 4


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
