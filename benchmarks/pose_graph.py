"""The pose graph of long flights by itself: processor time, and pairs that are false.

python benchmarks/pose_graph.py [--clouds 720 1500 3600] [--false 0 0.1 0.3] [--off 25 50]
                                [--seed 33000]

Three passes there and back, of which the autopilot errs by 3 cm and 0.9 degrees; nothing is
rendered. Each cloud is laid on the one before, on the third before, and every fourth on the two
nearest of other passes; pairs err as they state, and all clouds in common as `common_errors` has
it. Of the pairs between passes, a share is false: off along the skin by a pitch of rivets or two.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from ftp_dent_ros.pose import Pose

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test'))
from flown_pairs import CENTRE, batch, flight, joined, relatives

MM = 1e3


def apart(poses: list[Pose], others: list[Pose], reach: float = 1.0) -> float:
    """Largest difference of the distances of the skin below, up to a reach; metres."""
    found, true = (np.stack([p.apply(CENTRE) for p in each]) for each in (poses, others))
    first, second = np.random.default_rng(1).integers(0, len(poses), (2, 300_000))
    distances = np.linalg.norm(true[first] - true[second], axis=1)
    near = distances < reach
    off = np.abs(np.linalg.norm(found[first] - found[second], axis=1) - distances)
    return float(off[near].max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--clouds', type=int, nargs='+', default=[720, 1500, 3600])
    parser.add_argument('--false', type=float, nargs='+', default=[0.0, 0.1, 0.3])
    parser.add_argument('--off', type=float, nargs='+', default=[25.0, 50.0], help='millimetres')
    parser.add_argument('--seed', type=int, default=33000)
    arguments = parser.parse_args()
    for count in arguments.clouds:
        for share in arguments.false:
            for off in arguments.off if share else [0.0]:
                rng = np.random.default_rng([arguments.seed, count])
                poses = flight(rng, count)
                links, false = relatives(rng, poses, share, off / MM)
                graph, spent = joined(poses, links, arguments.seed)
                same = batch(graph)
                far = max(
                    np.linalg.norm(a.translation - b.translation)
                    for a, b in zip(graph.poses, poses, strict=True)
                )
                differ = max(
                    np.linalg.norm(a.translation - b.translation)
                    for a, b in zip(graph.poses, same.poses, strict=True)
                )
                each, last = MM * spent[:-1], spent[-1]
                print(
                    f'{count} clouds, {len(links)} pairs, {len(false)} false by {off:.0f} mm: '
                    f'{len(graph.left_out & false)} told, {len(graph.left_out - false)} true '
                    f'ones left out; distances below 1 m off by '
                    f'{MM * apart(graph.poses, poses):.2f} mm at most, poses by {MM * far:.0f}; '
                    f'from all at once {MM * differ:.4f} mm; processor time a cloud '
                    f'{np.median(each):.0f} ms (median), {each.mean():.0f} (mean), '
                    f'{each.max():.0f} at most, {last:.1f} s at the end',
                    flush=True,
                )


if __name__ == '__main__':
    main()
