"""``ftp-dent reconstruct``: one photograph to a point cloud."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import CloudError, ImageError
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern import read_pattern
from ftp_dent_ros.ply import write_ply
from ftp_dent_ros.profilometry import METHODS, UNWRAPPINGS, Reconstructor, Settings
from ftp_dent_ros.rig import read_rig

_SUFFIXES = ('.png', '.jpg', '.jpeg', '.tif', '.tiff')
_FRAME = 'camera_optical_frame'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    default = Settings()
    parser.add_argument('image', metavar='IMAGE', help='photograph (PNG, JPEG or TIFF, 8 bit)')
    parser.add_argument('--rig', required=True, metavar='RIG.yaml', help='calibrated rig')
    parser.add_argument(
        '--pattern', required=True, metavar='PATTERN.yaml', help='projected pattern'
    )
    parser.add_argument(
        '--output', required=True, metavar='CLOUD.ply', help='point cloud to write'
    )
    parser.add_argument('--method', choices=tuple(METHODS), default=default.method)
    parser.add_argument(
        '--unwrapping', choices=UNWRAPPINGS, help='of the Fourier methods; itoh by default'
    )
    parser.add_argument(
        '--tau', type=float, help="gain of Estrada's unwrapping, 0 to 1; 0.8 by default"
    )
    parser.add_argument(
        '--stride', type=int, default=default.stride, metavar='N', help='every N-th pixel only'
    )
    parser.add_argument(
        '--fast',
        action='store_true',
        default=None,
        help='least squares: correct once, not twice',
    )


def run(arguments: argparse.Namespace) -> int:
    """Reconstruct the photograph, write the cloud and print what it is."""
    settings = Settings(
        arguments.method,
        arguments.unwrapping,
        arguments.tau,
        arguments.stride,
        arguments.fast,
    )
    output = Path(arguments.output)
    if output.suffix.lower() != '.ply':
        raise CloudError(f'{output}: clouds are written as PLY: give a name that ends in .ply')
    reconstructor = Reconstructor(
        read_rig(find(arguments.rig)), read_pattern(find(arguments.pattern)), settings
    )
    measurement = reconstructor.measure(read_image(arguments.image))
    cloud = measurement.cloud
    write_ply(output, cloud, _FRAME)
    depth = cloud.points[..., 2][cloud.valid]
    print(f'{output}: {len(depth)} points, {cloud.valid.mean():.1%} of the image')
    if len(depth):
        low, middle, high = np.percentile(depth, [1, 50, 99])
        print(
            f'depth {middle:.3f} m ({low:.3f} to {high:.3f} m but for 1 % at each end), '
            f'red stripe at {measurement.stripe_depth:.3f} m'
        )
        if np.isfinite(cloud.sigma).any():
            sigma = 1e3 * np.nanpercentile(cloud.sigma[cloud.valid], [50, 95])
            print(f'standard uncertainty {sigma[0]:.4f} mm, below {sigma[1]:.4f} mm for 95 %')
    print(f'{measurement.coverage.share:.1%} of the lit area has points')
    for remark in measurement.coverage.remarks:
        print(f'  {remark}')
    return 0


def is_photograph(path: str | Path) -> bool:
    """Whether a file's name is that of a photograph."""
    return Path(path).suffix.lower() in _SUFFIXES


def read_image(path: str) -> NDArray[np.uint8]:
    """Read a colour photograph as RGB.

    Raises
    ------
    ImageError
        The file is no PNG, JPEG or TIFF, cannot be decoded, or has no 8-bit colours.
    """
    if not is_photograph(path):
        raise ImageError(f'{path}: not a photograph: give one of {", ".join(_SUFFIXES)}')
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as reason:
        raise ImageError(f'{path}: cannot be read ({reason.strerror}): check the path') from None
    with _silent():
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    if image is None:
        raise ImageError(f'{path}: empty, damaged or not an image: take it again')
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] not in (3, 4):
        raise ImageError(
            f'{path}: {image.dtype} in shape {image.shape}, not 8-bit colours: save it as RGB'
        )
    return np.ascontiguousarray(image[..., 2::-1])


@contextmanager
def _silent() -> Iterator[None]:
    """Keep the decoders' own words about damaged files off the standard error."""
    sys.stderr.flush()
    kept = os.dup(2)
    with open(os.devnull, 'wb') as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
