"""Field check: false alarms on good rigs, drifts found, on rendered walls, boards and skins.

python benchmarks/rig_check.py [--walls 1000] [--boards 200] [--charucos 100]
                               [--skins 100] [--drifts 300] [--first 1000]

Every wall and board is another: place, light, focus, noise, how flat it is and, of a board, how
large its print came out. The first of them are looked at with a drifted rig too, one drift each.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta
from tqdm import tqdm

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.board_check import check_by_board
from ftp_dent_ros.calibration.wall_check import Check, check, turned
from ftp_dent_ros.errors import CalibrationError, RefusedFrameError
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Lens, Rig, read_rig
from ftp_dent_ros.simulation import Panel, Photometry, Surface, Wave, render
from ftp_dent_ros.simulation.boards import board_surface, random_pose

RIG = read_rig(config_folder() / 'rig.yaml')
PATTERN = read_pattern(config_folder() / 'pattern.yaml')
BOARD = Board(10, 7, 0.025)
CHARUCO = (
    Board(10, 7, 0.025, 'DICT_5X5_100', 0.018),
    Board(7, 5, 0.035, 'DICT_4X4_50', 0.026),
)
# Standard deviation of the border off the plane of the middle, metres; of a print's size.
FLATNESS = 2e-5
PRINT = 3e-4
# Of the camera's exponent, and the share of walls that end before the lower rim of the frame.
GAMMA, ENDS_EARLY = 0.1, 0.3


def _turn(axis: int) -> Callable[[float], Rig]:
    return lambda sign: turned(RIG, sign * np.radians(0.05) * np.eye(3)[axis])


def _shift(name: str, axis: int) -> Callable[[float], Rig]:
    def shifted(sign: float) -> Rig:
        lens: Lens = getattr(RIG, name)
        matrix = lens.camera_matrix.copy()
        matrix[axis, 2] += sign
        return replace(RIG, **{name: replace(lens, camera_matrix=matrix)})

    return shifted


DRIFTS = {
    '0.05 degrees of pitch': _turn(0),
    '0.05 degrees of yaw': _turn(1),
    '0.05 degrees of roll': _turn(2),
    '1 px of projector columns': _shift('projector', 0),
    '1 px of projector rows': _shift('projector', 1),
    '1 px of camera columns': _shift('camera', 0),
    '1 px of camera rows': _shift('camera', 1),
}


@dataclass(frozen=True, eq=False)
class Target:
    """One photograph, and the check that suits what it shows."""

    image: NDArray[np.uint8]
    judge: Callable[[Rig, NDArray], Check]
    needs_cloud: bool = True

    def seen(self, by: Reconstructor, rig: Rig) -> Check:
        """What the check says of a rig."""
        none = np.full((1, 1, 3), np.nan)
        return self.judge(rig, by.measure(self.image).cloud.points if self.needs_cloud else none)


def light(rng: np.random.Generator, distance: float) -> Photometry:
    """An everyday camera and projector."""
    return Photometry(
        reference_distance=distance,
        exposure=rng.uniform(0.5, 0.95),
        ambient=rng.uniform(0, 0.1),
        read_noise=rng.uniform(0.8, 2.5),
        defocus_px=rng.uniform(0.6, 1.6),
        projector_gamma=rng.uniform(1, 2.2),
        camera_gamma=float(np.exp(rng.normal(0, GAMMA))),
    )


def wall(rng: np.random.Generator) -> Target:
    """A wall at 0.6 to 1 m that sags a little."""
    distance = rng.uniform(0.6, 1.0)
    pose = Pose.from_rpy(rng.uniform(-0.15, 0.15, 3), (0, 0, distance))
    sag = rng.normal(0, FLATNESS)
    border = distance * RIG.camera.width / 2 / RIG.camera.camera_matrix[0, 0]
    end = 0.1 * distance if rng.random() < ENDS_EARLY else 1.0
    # A wave so long that its border lies that far off the plane of its middle.
    bend = Wave(abs(sag) / (1 - np.cos(np.pi / 4)), 8 * border, 0.0, np.copysign(np.pi / 2, sag))
    panel = Panel(pose, (-1, 1, -1, end), waves=(bend,))
    image = render(RIG, PATTERN.draw(), Surface((panel,)), light(rng, distance), rng)
    return Target(image, lambda rig, points: check(rig, PATTERN, image, points, FLATNESS))


def skin(rng: np.random.Generator) -> Target:
    """A skin at 0.6 to 1 m: flat, a fuselage, or a wavy one."""
    distance = rng.uniform(0.6, 1.0)
    pose = Pose.from_rpy(rng.uniform(-0.15, 0.15, 3), (0, 0, distance))
    wave = Wave(2e-4, 0.3, *rng.uniform(0, np.pi, 2))
    radius, waves = ((0.0, ()), (rng.uniform(1.5, 3.0), ()), (3.0, (wave,)))[rng.integers(3)]
    panel = Panel(pose, (-1, 1, -1, 1), cylinder_radius=radius, waves=waves)
    image = render(RIG, PATTERN.draw(), Surface((panel,)), light(rng, distance), rng)
    return Target(image, lambda rig, points: check(rig, PATTERN, image, points, np.inf))


def board(rng: np.random.Generator) -> Target:
    """A board with the stripe on it, tilted by up to 35 degrees."""
    distance = rng.uniform(0.65, 0.9)
    print_of = replace(BOARD, square=BOARD.square * (1 + rng.normal(0, PRINT)))
    pose = random_pose(print_of, RIG, distance, rng)
    while not _holds_stripe(print_of, pose):
        pose = random_pose(print_of, RIG, distance, rng)
    surface = board_surface(print_of, pose)
    image = render(RIG, PATTERN.draw(), surface, light(rng, distance), rng)
    return Target(
        image, lambda rig, _: check_by_board(rig, PATTERN, BOARD, image, FLATNESS), False
    )


def charuco(rng: np.random.Generator) -> Target:
    """A ChArUco board of one of two kinds, otherwise as `board`."""
    of = CHARUCO[int(rng.integers(2))]
    distance = rng.uniform(0.65, 0.9)
    scale = 1 + rng.normal(0, PRINT)
    print_of = replace(of, square=of.square * scale, marker=of.marker * scale)
    pose = random_pose(print_of, RIG, distance, rng)
    while not _holds_stripe(print_of, pose):
        pose = random_pose(print_of, RIG, distance, rng)
    image = render(RIG, PATTERN.draw(), board_surface(print_of, pose), light(rng, distance), rng)
    return Target(image, lambda rig, _: check_by_board(rig, PATTERN, of, image, FLATNESS), False)


def _holds_stripe(of: Board, pose: Pose) -> bool:
    """Whether the stripe runs over the board, away from its border."""
    rows = of.points.reshape(of.rows, of.columns, 3)[:, [1, -2]]
    columns = RIG.projector.project(RIG.to_projector(pose.apply(rows.reshape(-1, 3))))[:, 0]
    left, right = np.sort(columns.reshape(-1, 2), axis=1).T
    stripe = PATTERN.stripe_center_px
    return bool(left.max() < stripe - 15 and stripe + 15 < right.min())


def tried(
    make: Callable[[np.random.Generator], Target], first: int, count: int, drifts: int
) -> Iterator[str]:
    """Run one kind of target; the lines of its report."""
    good = Reconstructor(RIG, PATTERN, Settings(stride=4))
    alarms, refused, normalised = 0, 0, []
    found: dict[str, list[bool]] = {name: [] for name in DRIFTS}
    blind: dict[str, int] = dict.fromkeys(DRIFTS, 0)
    for index in tqdm(range(count), unit=make.__name__):
        rng = np.random.default_rng(first + index)
        target = make(rng)
        try:
            said = target.seen(good, RIG)
        except (CalibrationError, RefusedFrameError) as reason:
            refused += 1
            tqdm.write(f'{make.__name__} {first + index}: {reason}')
            continue
        if not said.holds:
            alarms += 1
            tqdm.write(f'{make.__name__} {first + index}: {said.sentence}')
        normalised.append(
            [
                np.nan if axis in said.unknown else turn / deviation
                for axis, turn, deviation in zip(
                    ('pitch', 'yaw', 'roll'), said.turn, said.deviation, strict=True
                )
            ]
        )
        if index < drifts:
            name = list(DRIFTS)[index % len(DRIFTS)]
            rig = DRIFTS[name](rng.choice([-1.0, 1.0]))
            by = Reconstructor(rig, PATTERN, Settings(stride=4))
            judged = target.seen(by, rig)
            found[name].append(not judged.holds)
            if judged.holds and judged.unknown:
                blind[name] += 1
    done = count - refused
    bound = 100 * float(beta.ppf(0.95, alarms + 1, done - alarms)) if done > alarms else 100.0
    yield (
        f'{done} good {make.__name__}s ({refused} refused): {alarms} false alarms; with 95 % '
        f'confidence fewer than {bound:.2f} %'
    )
    with np.errstate(invalid='ignore'):
        spread = np.sqrt(np.nanmean(np.square(normalised), axis=0))
        largest = np.nanmax(np.abs(normalised), axis=0)
    yield (
        'turns over their stated deviation, rms (largest): '
        'pitch {:.2f} ({:.1f}), yaw {:.2f} ({:.1f}), roll {:.2f} ({:.1f})'
    ).format(*np.ravel([spread, largest], order='F'))
    for name, each in found.items():
        if each:
            note = f', {blind[name]} of the rest told what they cannot know' if blind[name] else ''
            yield f'  {name}: found {sum(each)} of {len(each)}{note}'


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--walls', type=int, default=1000)
    parser.add_argument('--boards', type=int, default=200)
    parser.add_argument('--charucos', type=int, default=100)
    parser.add_argument('--skins', type=int, default=100)
    parser.add_argument('--drifts', type=int, default=300, help='targets seen by a drifted rig')
    parser.add_argument('--first', type=int, default=1000)
    arguments = parser.parse_args()
    for make, count in (
        (wall, arguments.walls),
        (board, arguments.boards),
        (charuco, arguments.charucos),
        (skin, arguments.skins),
    ):
        if count:
            for line in tried(make, arguments.first, count, arguments.drifts):
                print(line, flush=True)


if __name__ == '__main__':
    main()
