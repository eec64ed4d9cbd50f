"""Two surveys of one skin, made by hand: what changed between them is known."""

from dataclasses import replace

import numpy as np
from dent_samples import make_dent, scattered

from ftp_dent_ros.dents.dent import Estimate
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.result import CoverageCells, SurveyedDent, SurveyResult

DAY_NS = 86_400 * 10**9
SIZE = 1.2, 0.6
# Of the dents by their numbers: what becomes of them. The others stay as they are.
GROWN, REPAIRED, NEW, UNSEEN = 1, 2, 3, 4
COUNT = 24
ELSEWHERE = Pose.from_rpy((0.03, -0.02, 2.5), (7.0, -3.0, 1.0))


def pair(seed=1, count=COUNT):
    """The earlier and the later survey; the later did not look at dent `UNSEEN`."""
    rng = np.random.default_rng(seed)
    places = scattered(rng, count, (0.05, 0.05), np.array(SIZE) - 0.05, 0.06)
    depths, widths = rng.uniform(4e-4, 2e-3, count), rng.uniform(0.015, 0.04, count)
    unseen = places[UNSEEN - 1]
    earlier, later = [], []
    for number, (place, depth, width) in enumerate(zip(places, depths, widths, strict=True), 1):
        for dents, pose, more in (
            (earlier, Pose.from_rpy((0, 0, 0), (0, 0, 0)), 0.0),
            (later, ELSEWHERE, 5e-5 * (number == GROWN)),
        ):
            dent = make_dent(
                pose.apply(np.array([*place, 0.0]) + rng.normal(0, 2e-4, 3)),
                normal=pose.rotation.apply([0.0, 0, 1]),
                axis=pose.rotation.apply([1.0, 0, 0]),
                width=width,
                length=1.3 * width,
            )
            measured = Estimate(depth + more + 3e-6 * rng.normal(), 5e-6)
            dent = replace(dent, depth=measured)
            dents.append(SurveyedDent(number, dent, np.eye(3) * 1e-6, 5))
    earlier = [each for each in earlier if each.number != NEW]
    later = [each for each in later if each.number not in (REPAIRED, UNSEEN)]
    same = Pose.from_rpy((0, 0, 0), (0, 0, 0))
    return (
        SurveyResult(
            'before', (), 20000 * DAY_NS, 'map', tuple(earlier), coverage=cells(same, [])
        ),
        SurveyResult(
            'after', (), 20400 * DAY_NS, 'map', tuple(later), coverage=cells(ELSEWHERE, [unseen])
        ),
    )


def cells(pose, gaps, size=0.01):
    """Coverage of the skin but for discs of 20 mm around places."""
    grid = np.stack(
        np.meshgrid(*(np.arange(size / 2, side, size) for side in SIZE), indexing='ij'), -1
    ).reshape(-1, 2)
    for gap in gaps:
        grid = grid[np.linalg.norm(grid - gap, axis=1) > 0.02]
    positions = pose.apply(np.column_stack([grid, np.zeros(len(grid))])).astype(np.float32)
    return CoverageCells(size, positions, np.full(len(grid), 1e-4, np.float32))
