"""``ftp-dent reconstruct``: one photograph to a point cloud."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from ftp_dent_ros.cli import argument
from ftp_dent_ros.cloud.ply import write_ply
from ftp_dent_ros.cloud.seen import CAMERA_FRAME
from ftp_dent_ros.errors import CloudError, NoFringesError
from ftp_dent_ros.files import check_writable, find, write_png
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.photograph.file import read_photograph
from ftp_dent_ros.profilometry import METHODS, UNWRAPPINGS, Reconstructor, Settings
from ftp_dent_ros.rig.rig import read_rig

ARGUMENTS = (
    argument('image', metavar='IMAGE', help='photograph (PNG, JPEG or TIFF)'),
    argument('--rig', required=True, metavar='RIG.yaml', help='calibrated rig'),
    argument('--pattern', required=True, metavar='PATTERN.yaml', help='projected pattern'),
    argument('--output', required=True, metavar='CLOUD.ply', help='point cloud to write'),
    argument('--skin', metavar='FILE.png', help='image of the skin without the fringes to write'),
    argument(
        '--encoding',
        default='',
        metavar='NAME',
        help='what the file cannot say: raw pixels or bits, as bayer_rggb12 or mono10',
    ),
    argument('--method', choices=tuple(METHODS), default=Settings.method),
    argument('--unwrapping', choices=UNWRAPPINGS, help='of the Fourier methods; itoh by default'),
    argument('--tau', type=float, help="gain of Estrada's unwrapping, 0 to 1; 0.8 by default"),
    argument(
        '--stride', type=int, default=Settings.stride, metavar='N', help='every N-th pixel only'
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Reconstruct the photograph, write the cloud and print what it is."""
    settings = Settings(
        arguments.method,
        arguments.unwrapping,
        arguments.tau,
        arguments.stride,
    )
    output = Path(arguments.output)
    if output.suffix.lower() != '.ply':
        raise CloudError(f'{output}: clouds are written as PLY: give a name that ends in .ply')
    rig = read_rig(find(arguments.rig))
    reconstructor = Reconstructor(rig, read_pattern(find(arguments.pattern)), settings)
    photograph = read_photograph(arguments.image, arguments.encoding)
    for path in filter(None, (output, arguments.skin)):
        check_writable(path)
    measurement = reconstructor.measure(photograph, True)
    cloud = measurement.cloud
    if not cloud.valid.any():
        reasons = '; '.join(measurement.coverage.remarks) or 'the fringes do not explain it'
        raise NoFringesError(f'{arguments.image}: gives no point: {reasons}')
    if photograph.encoding != 'rgb8':
        origin = 'as given' if arguments.encoding else 'tell by --encoding if it is not'
        print(f'{arguments.image}: taken for {photograph.encoding} ({origin})')
    if arguments.skin:
        write_png(arguments.skin, cloud.skin)
    write_ply(output, cloud, CAMERA_FRAME, rig.id)
    depth = cloud.points[..., 2][cloud.valid]
    print(f'{output}: {len(depth)} points, {cloud.valid.mean():.1%} of the image')
    stripe = reconstructor.pattern.code == 'stripe'
    low, middle, high = np.percentile(depth, [1, 50, 99])
    print(
        f'depth {middle:.3f} m ({low:.3f} to {high:.3f} m but for 1 % at each end)'
        + (f', red stripe at {measurement.stripe_depth:.3f} m' if stripe else '')
    )
    if np.isfinite(cloud.sigma).any():
        sigma = 1e3 * np.nanpercentile(cloud.sigma[cloud.valid], [50, 95])
        print(f'standard uncertainty {sigma[0]:.4f} mm, below {sigma[1]:.4f} mm for 95 %')
    print(f'{measurement.coverage.share:.1%} of the lit area has points')
    if measurement.epipolar is not None and measurement.epipolar.seen:
        print(measurement.epipolar.sentence)
    for remark in measurement.coverage.remarks:
        print(f'  {remark}')
    return 0
