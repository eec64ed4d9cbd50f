"""Surveys that something is wrong with, the map that is drawn, and what poses state of themselves.

python benchmarks/flown_surveys.py          # all rows
python benchmarks/flown_surveys.py map way  # those whose names begin so

Clouds are made without photographs (`flown_skin`), so that all of it takes some minutes on one
core. A row is a line: its name, and its figures. "Over u" is an error over its stated standard
uncertainty.
"""

from __future__ import annotations

import math
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from bag_samples import (
    CLOUD,
    DIAGNOSTICS,
    IMAGE,
    LOCATED,
    SECOND,
    cloud_message,
    data_of,
    diagnostics,
    image,
    located,
    place,
    topic,
)
from flown_skin import DISTANCE, ROWS, STATED, FlownSkin, erring
from measures import MM, root_mean_square
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.reader import Bag, open_bag
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.recording.writer import BagWriter
from ftp_dent_ros.survey.footprint import Footprint, unrolled
from ftp_dent_ros.survey.information import RelativePose
from ftp_dent_ros.survey.joining import Joining
from ftp_dent_ros.survey.mosaic import Mosaic
from ftp_dent_ros.survey.patch import patch_of
from ftp_dent_ros.survey.pose_graph import Node, PairLink, PoseGraph
from ftp_dent_ros.survey.surveying import survey_bags

HALF_S = 500_000_000
START_NS = 1_760_000_000 * SECOND
TYPES = {'/skin': IMAGE, '/points': CLOUD, '/tagged/camera_pose': LOCATED}
Row = tuple[str, dict[str, float]]


def record(
    folder,
    skin,
    poses,
    stated,
    without=(),
    start_ns=START_NS,
    rig='',
    rows=ROWS,
    covariance=STATED,
):
    """A bag of clouds seen from poses, in which the autopilot's are stated, or None."""
    with BagWriter(folder) as writer:
        if rig:
            writer.add_topic(DIAGNOSTICS)
            writer.write([diagnostics(0, rig=rig)])
        for index, (pose, said) in enumerate(zip(poses, stated, strict=True)):
            stamp = start_ns + index * HALF_S
            seen = contents(skin.seen(pose, index), said, stamp, rows, covariance)
            for name, data in seen:
                if name not in without and (name, index) not in without:
                    writer.add_topic(topic(name, TYPES[name]))
                    writer.write([Message(name, TYPES[name], stamp, stamp, data)])
    return folder


def contents(cloud, pose, stamp_ns, rows, covariance) -> Iterator[tuple[str, bytes]]:
    """Messages of one cloud."""
    eye = 'camera_optical_frame'
    yield '/skin', data_of(image(stamp_ns, eye, cloud.skin[:rows], 'mono8'), IMAGE)
    yield '/points', data_of(cloud_message(stamp_ns, eye, cloud), CLOUD)
    if pose is not None:
        there = place(pose.translation, pose.quaternion)
        yield '/tagged/camera_pose', located(stamp_ns, there, covariance)


# Dents of the flown skins: x, y, width, depth, metres.
DENTS = (
    (0.05, 0.02, 0.03, 5e-4),
    (0.15, -0.04, 0.025, 3e-4),
    (0.24, 0.05, 0.028, 8e-4),
    (0.33, -0.01, 0.03, 4e-4),
)
CLOUDS = 9


def shifted(poses: list[Pose], by: NDArray) -> list[Pose]:
    return [Pose(pose.rotation, pose.translation + by) for pose in poses]


def surveyed(bags: list[Bag]) -> dict[str, float]:
    """What the survey of some bags finds, over all its parts, and by which sizes it is off."""
    parts = survey_bags(bags, 'survey', SmallestDent(), '', lambda: None)
    seen, false, off, missed, doubtful = 0, 0, [], 0, 0
    for part in parts:
        dents = [each.dent for each in part.result.dents if each.dent.kind == 'dent']
        depths = np.array([dent.depth.value for dent in dents])
        taken = set()
        for *_, depth in DENTS:
            near = [
                k
                for k in np.argsort(np.abs(depths - depth)).tolist()
                if k not in taken and abs(depths[k] - depth) < 0.15 * depth
            ]
            if not near:
                missed += 1
                continue
            taken.add(near[0])
            off.append((depths[near[0]] - depth) / dents[near[0]].depth.uncertainty)
        seen += len(taken)
        # Of two entries that may be one, both say so.
        reasons = [each.dent.reason for each in part.result.dents]
        doubted = sum('may be the same' in text for text in reasons) // 2
        doubted += sum('may be one of theirs' in text for text in reasons)
        doubtful += doubted
        false += len(part.result.dents) - len(taken) - doubted
    clouds = sum(len(part.joined.numbers) for part in parts)
    return {
        'clouds': clouds,
        'parts': len(parts),
        'found': seen,
        'missed': missed,
        'false': false,
        'twice, and said to be': doubtful,
        'depth over u': root_mean_square(off),
        'm2': sum(part.mosaic.area for part in parts),
    }


def apart(folder: Path) -> Iterator[Row]:
    """Two flights over one skin whose maps differ, by what their poses state and by more."""
    skin = FlownSkin(31, dents=DENTS)
    for off, sigma in ((0.2, 0.3), (0.4, 0.3), (2.0, 2.0), (20.0, 0.3), (0.2, 0.03), (0.4, 0.03)):
        covariance = np.diag([sigma**2] * 3 + [0.015**2] * 3)
        bags = []
        for number in range(2):
            poses = list(skin.flight(CLOUDS, y=0.01 * number))
            said = shifted(erring(poses, number), number * off * np.array([0.8, 0.6, 0]))
            name = f'{off} {sigma} {number}'
            start = START_NS + number * 1000 * SECOND
            path = record(folder / name, skin, poses, said, start_ns=start, covariance=covariance)
            bags.append(open_bag(path))
        yield f'{off:g} m apart, poses state {sigma:g} m', surveyed(bags)


def lacking(folder: Path) -> Iterator[Row]:
    """A stray cloud, poses or skin that are missing, and a pass with the camera turned."""
    skin = FlownSkin(31, dents=DENTS)
    poses = list(skin.flight(CLOUDS))
    said = erring(poses, 1)
    stray = list(said)
    stray[4] = Pose(said[4].rotation, said[4].translation + np.array([0.1, 0.05, 0]))
    every_second = [pose if k % 2 else None for k, pose in enumerate(said)]
    turn = Rotation.from_euler('z', np.pi)
    back = [Pose(each.rotation * turn, each.translation) for each in skin.flight(CLOUDS, y=0.02)]
    both = [*poses, *back[::-1]]
    for name, true, stated, without in (
        ('as it should be', poses, said, ()),
        ('a stray cloud without skin', poses, stray, (('/skin', 4),)),
        ('half of the poses missing', poses, every_second, ()),
        ('a turned pass', both, erring(both, 1), ()),
        ('no skin', poses, said, ('/skin',)),
    ):
        bag = open_bag(record(folder / name, skin, true, stated, without))
        yield name, surveyed([bag])


# Of the skins that are only drawn: radius at x = 0, and by how much it falls over a metre.
FORMS = {'cylinder': (1.9, 0.0), 'cone': (1.9, 0.12), 'plane': (1e6, 0.0)}
APART = 0.2


class Form:
    """A cone about x whose top is the plane z = 0 at x = 0, and how it is unrolled."""

    def __init__(self, name: str) -> None:
        self.radius, fall = FORMS[name]
        self.half = math.atan(fall)

    def points(self, x: NDArray, around: NDArray) -> NDArray:
        """Points of places along the cone's lines and around it at x = 0, metres."""
        angle, out = around / self.radius, self.radius - x * math.sin(self.half)
        turned = np.stack([np.sin(angle), np.cos(angle)], axis=-1) * out[..., None]
        return np.stack([x * math.cos(self.half), turned[..., 0], turned[..., 1]], -1) - [
            0,
            0,
            self.radius,
        ]

    def apart(self, x: NDArray, around: NDArray) -> NDArray:
        """Lengths on the skin between the two last axes' places."""
        if not self.half:
            return np.hypot(np.diff(x, axis=-1), np.diff(around, axis=-1))[..., 0]
        side = self.radius / math.sin(self.half) - x
        turn = np.diff(around, axis=-1)[..., 0] / self.radius * math.sin(self.half)
        one, other = side[..., 0], side[..., 1]
        return np.sqrt(one**2 + other**2 - 2 * one * other * np.cos(turn))

    def pose(self, x: float, around: float) -> Pose:
        """A camera that looks at a place from in front, its x along the skin."""
        angle = around / self.radius
        normal = Rotation.from_rotvec([-angle, 0, 0]) * Rotation.from_rotvec([0, self.half, 0])
        at = self.points(np.array(x), np.array(around))
        down = Rotation.from_euler('x', np.pi)
        return Pose(normal * down, at + DISTANCE * normal.apply([0.0, 0, 1]))

    def seen(self, x: float, around: float, rng: np.random.Generator) -> tuple[Cloud, Pose]:
        """A cloud on the skin's own lines, 4 mm apart, with noise; and its camera."""
        u, v = np.meshgrid(np.arange(-0.17, 0.17, 0.004), np.arange(-0.11, 0.11, 0.004))
        pose = self.pose(x, around)
        points = pose.inverse().apply(self.points(x + u, around + v))
        points = points + 5e-6 * rng.normal(size=points.shape)
        # As a camera has it: columns to the right.
        return Cloud(points.astype(np.float32), np.ones(u.shape, np.float32)), pose


def drawn(form: Form, passes: int, turn: Rotation, clouds: int = 8, tilted: bool = False):
    """What is drawn of so many passes, turned about the map's vertical."""
    rng = np.random.default_rng(passes)
    frame, seen = Pose(turn, np.array([3.0, -7.0, 2.0])), []
    for number in range(passes):
        for k in range(clouds):
            cloud, pose = form.seen(0.2 * k - 0.7, APART * (number - (passes - 1) / 2), rng)
            seen.append((cloud, frame @ pose))
    footprints = [Footprint.of(cloud, patch_of(cloud)) for cloud, _ in seen]
    skin, places = unrolled(footprints, [pose for _, pose in seen])
    flat = np.concatenate(places)[:, :2]
    mosaic = Mosaic(skin, flat.min(axis=0) - 0.05, flat.max(axis=0) + 0.05)
    for cloud, pose in seen if not tilted else ():
        mosaic.add(cloud, pose, None)
    return mosaic, frame


def lengths(_: Path) -> Iterator[Row]:
    """Lengths on the map against those on the skin, and its area."""
    rng = np.random.default_rng(5)
    for name in FORMS:
        form = Form(name)
        for passes in (1, 2, 4, 12):
            seen, frame = drawn(form, passes, Rotation.from_euler('z', 0.7))
            half = np.array([0.85, APART * passes / 2])
            x, around = np.moveaxis(rng.uniform(-half, half, (4000, 2, 2)), -1, 0)
            true = form.apart(x, around)
            on_map = seen.skin.place(frame.apply(form.points(x, around)))[..., :2]
            off = np.linalg.norm(np.diff(on_map, axis=1)[:, 0], axis=-1) - true
            # Of the clouds' points, 4 mm apart, each stands for as much around it.
            wide, high = 1.4 + 0.34, APART * (passes - 1) + 0.22
            yield (
                f'map, {name}, {passes} passes',
                {
                    'length off mm at most': MM * float(np.abs(off[true < 1]).max()),
                    'area off %': 100
                    * (np.count_nonzero(seen.views) * seen.pitch**2 / (wide * high) - 1),
                    'radius m': seen.skin.radius,
                },
            )


def way_up(_: Path) -> Iterator[Row]:
    """Whether a wall and a crown are drawn the same way up whatever way the aircraft heads."""
    for name, tilt in (('wall', math.pi / 2), ('crown', 0.0)):
        right = []
        for heading in np.arange(100) * 2 * math.pi / 100:
            turn = Rotation.from_euler('z', heading) * Rotation.from_euler('x', tilt)
            seen, _ = drawn(Form('cylinder'), 2, turn, 3, True)
            across, along = turn.apply([0.0, 1, 0]), turn.apply([1.0, 0, 0])
            right.append((seen.skin.around @ across > 0.99, seen.skin.axis @ along > 0.99))
        same = max(np.mean(np.all(right, axis=1)), np.mean(~np.any(right, axis=1)))
        yield f'way up, {name}', {'of 100 headings': 100 * float(same)}


def laps(folder: Path) -> Iterator[Row]:
    """The deviation that is drawn beside a lap, where the skin is as it should be."""
    for lap, turn in (((0.03, 1.2e-3), 0.12), ((0.0, 1.2e-3), 0.0), ((-0.02, -4e-4), 0.1)):
        skin = FlownSkin(35, dents=((0.1, -0.05, 0.03, 3e-4),), lap=lap)
        poses = [pose for k in range(2) for pose in skin.flight(6, y=turn * k - 0.04)]
        name = f'lap of {MM * lap[1]:g} mm, passes {turn:g} m apart'
        bag = open_bag(record(folder / name, skin, poses, poses, covariance=STATED / 1e4))
        (part,) = survey_bags([bag], 'survey', SmallestDent(), '', lambda: None)
        mosaic = part.mosaic
        rows, columns = np.indices(mosaic.shape)
        at = mosaic.skin.points(mosaic.low + mosaic.pitch * (np.stack([columns, rows], -1) + 0.5))
        off = np.hypot(at[..., 0] - 0.1, at[..., 1] + 0.05)
        shown = np.isfinite(mosaic.deviation)
        bare, dent = np.abs(mosaic.deviation[shown & (off > 0.03)]), shown & (off < 0.003)
        figures = {
            f'off {MM * limit:g} mm %': 100 * (bare > limit).mean() for limit in (3e-5, 1e-4)
        }
        yield (
            name,
            figures
            | {
                'blank %': 100 * (1 - shown[mosaic.views > 0].mean()),
                'dent of 0.3 mm shown': MM * mosaic.deviation[dent].mean()
                if dent.any()
                else math.nan,
                'entries': len(part.result.dents),
                'steps': sum(each.dent.kind == 'step' for each in part.result.dents),
            },
        )


def stated_places(_: Path) -> Iterator[Row]:
    """Places in the map of flights whose poses err by a constant, or by a drift, or by both."""
    for count in (24, 150, 1200):
        for kind, constant in (('constant', 1.0), ('drift', 0.0), ('both', 0.5)):
            ratios, stated_mm, yaws = [], [], []
            for seed in range(24 if count < 1000 else 6):
                rng = np.random.default_rng([seed, count])
                poses = back_and_forth(rng, count)
                said = wandering(rng, poses, constant)
                graph = PoseGraph()
                for pose in said:
                    add_tied(graph, rng, poses, pose)
                graph.settle()
                covariances = graph.covariances()[[0, count // 2, count - 1]]
                for which, covariance in zip((0, count // 2, count - 1), covariances, strict=True):
                    error = difference(graph.poses[which], poses[which])
                    ratios.append(math.sqrt(error @ np.linalg.solve(covariance, error) / 6))
                    stated_mm.append(MM * math.sqrt(np.trace(covariance[:3, :3]) / 3))
                    yaws.append(math.degrees(math.sqrt(covariance[5, 5])))
            yield (
                f'place in the map, {count} clouds, {kind}',
                {
                    'over u': root_mean_square(ratios),
                    'stated mm': float(np.mean(stated_mm)),
                    'stated yaw degrees': float(np.mean(yaws)),
                },
            )


def add_tied(graph: PoseGraph, rng: np.random.Generator, poses: list[Pose], said: Pose) -> None:
    """The next of the true poses in a graph, as it is said to be, and tied to others."""
    sigma = np.array([3e-5, 2.5e-5, 3e-6, 1.4e-5, 5e-6, 3.3e-5])
    number, centre = len(graph.nodes), np.array([0, 0, DISTANCE])
    graph.add(Node(said, STATED, 0.5 * number, 0), said)
    others = [number - back for back in (1, 3) if number >= back]
    if number % 24 > 18 and number >= 24:
        others.append(number - 2 * (number % 24) - 1)
    for other in others:
        true = poses[other].inverse() @ poses[number]
        error = rng.normal(0, sigma)
        turn = Rotation.from_rotvec(error[3:])
        found = Pose(turn, error[:3] + centre - turn.apply(centre)) @ true
        seen = RelativePose(found, centre, np.diag(1 / sigma**2), 6)
        graph.links.append(PairLink(other, number, seen))


def growing(_: Path) -> Iterator[Row]:
    """Processor time of moving the poses after each cloud, as a flight grows."""
    rng = np.random.default_rng(3)
    poses = back_and_forth(rng, 1200)
    graph, spent = PoseGraph(), []
    for count, pose in enumerate(wandering(rng, poses, 0.5), start=1):
        add_tied(graph, rng, poses, pose)
        if count > 1:
            link = graph.links[-1]
            graph.put(count - 1, graph.pose(link.first) @ link.relative.pose)
        began = time.process_time()
        graph.update()
        spent.append(MM * (time.process_time() - began))
        if count in (24, 200, 1200):
            last = spent[-max(20, count // 5) :]
            figures = {'ms a cloud': float(np.mean(last)), 'ms at most': max(last)}
            yield f'poses moved after {count} clouds', figures


def difference(pose: Pose, other: Pose) -> NDArray:
    turn = (pose.rotation * other.rotation.inv()).as_rotvec()
    return np.concatenate([pose.translation - other.translation, turn])


def back_and_forth(rng: np.random.Generator, count: int) -> list[Pose]:
    """Passes of 24 clouds over a level skin."""
    down, poses = Rotation.from_euler('x', np.pi), []
    for number in range(count):
        along, line = number % 24, number // 24
        x = 0.045 * (along if line % 2 == 0 else 23 - along)
        wobble = Rotation.from_rotvec(rng.normal(0, 0.008, 3))
        poses.append(Pose(wobble * down, np.array([x, 0.2 * line, DISTANCE])))
    return poses


def wandering(rng: np.random.Generator, poses: list[Pose], constant: float) -> list[Pose]:
    """Poses off by as much as `STATED`, of which a share of the variance is constant.

    And by a little that is another each time.
    """
    fixed = math.sqrt(constant) * rng.multivariate_normal(np.zeros(6), STATED)
    keep, drift = math.exp(-0.5 / 10), rng.multivariate_normal(np.zeros(6), STATED)
    said = []
    for pose in poses:
        new = rng.multivariate_normal(np.zeros(6), STATED)
        drift = keep * drift + math.sqrt(1 - keep**2) * new
        anew = rng.normal(0, np.repeat((3e-3, 1e-3), 3))
        error = fixed + math.sqrt(1 - constant) * drift + anew
        turn = Rotation.from_rotvec(error[3:])
        said.append(Pose(turn * pose.rotation, pose.translation + error[:3]))
    return said


def repeating(_: Path, count: int = 300) -> Iterator[Row]:
    """Many clouds along a skin of rivets and nothing else."""
    skin, joining = FlownSkin(41, pitch=0.025), Joining()
    poses = []
    for line in range(count // 50):
        there = list(skin.flight(50, start=-1.2, y=0.09 * (line % 4) - 0.13))
        poses += there[:: -1 if line % 2 else 1]
    said, spent = erring(poses, 4), 0.0
    for number, (pose, stated) in enumerate(zip(poses, said, strict=True)):
        cloud = skin.seen(pose, number)
        began = time.process_time()
        joining.add(number * HALF_S, cloud, stated, STATED)
        spent += time.process_time() - began
    joining.finish()
    middle = count // 2
    covariances, ratios, sizes = joining.graph.covariances(anchor=middle), [], []
    found, true = joining.graph.poses[middle].inverse(), poses[middle].inverse()
    placed = joining.graph.poses
    for number, (pose, where) in enumerate(zip(placed, poses, strict=True)):
        if number != middle:
            error = difference(found @ pose, true @ where)
            turn = np.kron(np.eye(2), placed[middle].rotation.as_matrix())
            error = turn @ error
            ratios.append(math.sqrt(error @ np.linalg.solve(covariances[number], error) / 6))
            sizes.append(MM * np.linalg.norm(error[:3]))
    links = joining.graph.links
    yield (
        f'{count} clouds of a repeating skin',
        {
            'off mm': root_mean_square(sizes),
            'over u': root_mean_square(ratios),
            'not tied %': 100 * float(np.mean([link.relative.rank < 6 for link in links])),
            'ms a cloud': MM * spent / count,
            'MB': resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        },
    )


ROWS_OF: dict[str, Callable[[Path], Iterator[Row]]] = {
    'apart': apart,
    'lacking': lacking,
    'map': lengths,
    'way': way_up,
    'laps': laps,
    'places': stated_places,
    'growing': growing,
    'repeating': repeating,
}


def main(wanted: list[str]) -> None:
    for name, rows in ROWS_OF.items():
        if wanted and not any(name.startswith(each) for each in wanted):
            continue
        began = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            for row, figures in rows(Path(folder)):
                words = ', '.join(f'{key} {value:.4g}' for key, value in figures.items())
                print(f'{row:46}  {words}', flush=True)
        print(f'  ({name}: {time.monotonic() - began:.0f} s)', flush=True)


if __name__ == '__main__':
    main(sys.argv[1:])
