"""A cloud's depth in the convention of ``compressed_depth_image_transport``, for others' tools.

A ``sensor_msgs/CompressedImage`` of the format ``32FC1; compressedDepth png``: a header of 12
bytes (1 for inverse depth, then two float32 A and B), and a PNG of 16 bits with ``A / z + B``, 0
for none. Here the 65535 steps are laid over the depths of the cloud, so that no depth is off by
more than ``z^2 (1/z_nearest - 1/z_farthest) / 131068``: 1.1 um at 0.8 m in a cloud from 0.75 to
0.9 m, 15 um in one from 0.3 to 3 m. There is neither intensity nor uncertainty in it, and x and y
need the camera_info.
"""

from __future__ import annotations

import struct

import cv2
import numpy as np

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CodecError

FORMAT = '32FC1; compressedDepth png'
_HEAD = struct.Struct('<iff')
# compressed_depth_image_transport's format of the inverse depth, and the largest of 16 bits.
_INVERSE_DEPTH = 1
_STEPS = 65535


def depth_image(cloud: Cloud) -> bytes:
    """The `data` of a CompressedImage; raises `CodecError` if no point is ahead."""
    z = cloud.points[..., 2].astype(np.float64)
    seen = np.isfinite(z) & (z > 0)
    inverse = np.where(seen, 1 / np.where(seen, z, 1), 0)
    nearest = float(inverse.max(initial=0.0))
    farthest = float(inverse.min(where=seen, initial=np.inf))
    if not seen.any():
        raise CodecError('the cloud has no depths ahead of the camera: none are sent')
    # Of float32, as the header holds them, with room at both ends for their rounding.
    span = max(nearest - farthest, 1e-4 * nearest)
    scale = float(np.float32((_STEPS - 3) / span))
    start = float(np.float32(2 - scale * farthest))
    steps = np.where(seen, np.clip(np.rint(scale * inverse + start), 1, _STEPS), 0)
    done, png = cv2.imencode('.png', steps.astype(np.uint16), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not done:
        raise CodecError('the depths cannot be compressed: look at their size')
    return _HEAD.pack(_INVERSE_DEPTH, scale, start) + png.tobytes()
