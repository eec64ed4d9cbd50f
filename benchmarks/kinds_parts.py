"""Kinds of parts: plates, seams, doors, holes, inlets, panes and rows, with dents in their way.

None was there when the package was built; each is a function of a random generator.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from kind_scenes import (
    Kind,
    KindScene,
    by_contour,
    scene,
    seed,
    skin,
    three_dents,
)

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import (
    Dirt,
    DomedRivet,
    Lettering,
    MissingRivet,
    Opening,
    Paint,
    Panel,
    Rivet,
    scratches,
)
from ftp_dent_ros.simulation.dents import Gaussian, Valley


def plate_in_dent(rng: np.random.Generator) -> KindScene:
    """A doubler whose edge runs through the middle of a dent that both have."""
    base = skin(rng, dents=())
    thick, turn = rng.uniform(0.0004, 0.0012), rng.uniform(-0.5, 0.5)
    pose = base.pose @ Pose.from_rpy((0, 0, turn), (0.01, 0.0, 0.0))
    dents = (
        by_contour(-0.05, 0.0, 0.04, 0.04, 0.0010),
        by_contour(0.0, 0.0, 0.03, 0.03, 0.0005, 0.0, Gaussian()),
        by_contour(0.11, 0.05, 0.03, 0.03, 0.0005, 0.0, Gaussian()),
    )
    upper = pose @ Pose.from_rpy((0, 0, 0), (0, 0, -thick))
    return scene(
        Panel(upper, (-0.05, 0.05, -0.04, 0.04), dents=dents[:2]),
        # What the plate hides has no dent in its middle.
        Panel(pose, (-2, 2, -2, 2), dents=dents[::2]),
    )


def on_a_row(rivet: type, **options) -> Kind:
    """Dents whose middles, or rims, lie on a row of rivets."""

    def kind(rng: np.random.Generator) -> KindScene:
        x, y = 0.0, rng.uniform(-0.01, 0.01)
        row = tuple(rivet(x - 0.2 + 0.02 * i, y, **options) for i in range(21))
        dents = (
            by_contour(-0.09, y + rng.uniform(-0.005, 0.005), 0.045, 0.045, 0.0010),
            by_contour(0.02, y + 0.012, 0.040, 0.030, 0.0006, rng.uniform(0, 3)),
            by_contour(0.12, y - 0.014, 0.030, 0.030, 0.00035, 0.0, Gaussian()),
        )
        return scene(skin(rng, dents=dents, rivets=row))

    return kind


def pair_at_a_seam(rng: np.random.Generator) -> KindScene:
    """Two sheets a millimetre apart, a dent on either side of the seam, and one through it."""
    pose = skin(rng, dents=()).pose @ Pose.from_rpy((0, 0, rng.uniform(-1.5, 1.5)), (0, 0, 0))
    dents = (
        by_contour(-0.02, -0.04, 0.03, 0.03, 0.0008),
        by_contour(0.02, -0.035, 0.025, 0.025, 0.0004, 0.0, Gaussian()),
        by_contour(0.0, 0.045, 0.05, 0.04, 0.0010, 0.0, Gaussian()),
    )
    gap = rng.uniform(0.0005, 0.002) / 2
    return scene(
        Panel(pose, (-2, -gap, -2, 2), dents=dents[::2]),
        Panel(pose, (gap, 2, -2, 2), dents=dents[1:]),
    )


def holes(rng: np.random.Generator) -> KindScene:
    """A row of open holes, one countersunk sheet's worth, beside dents."""
    x = rng.uniform(-0.05, 0.05)
    row = tuple(MissingRivet(x, -0.2 + 0.018 * i) for i in range(23))
    return scene(skin(rng, rivets=row))


def inlet(rng: np.random.Generator) -> KindScene:
    """A flush inlet: a ramp that goes in from the skin to 25 mm deep, walls in the dark."""
    base = skin(rng, dents=three_dents(rng, (-0.13, -0.04), (0.13, 0.05), (-0.12, 0.07)))
    turn, slope = rng.uniform(0, 2 * math.pi), math.atan(0.025 / 0.12)
    hole = Opening(0.01, 0.0, 0.12, 0.06, turn)
    ramp = base.pose @ Pose.from_rpy((0, 0, turn), (0.01, 0, 0))
    ramp = ramp @ Pose.from_rpy((0, -slope, 0), (0, 0, 0.0125))
    floor = Panel(ramp, (-0.07, 0.07, -0.035, 0.035))
    return scene(replace(base, openings=(hole,)), floor)


def door(rng: np.random.Generator) -> KindScene:
    """A door that stands 0.5 to 2 mm proud in a gap of 3 to 6 mm, letters over both."""
    base = skin(rng, dents=())
    proud, gap = rng.uniform(0.0005, 0.002), rng.uniform(0.003, 0.006)
    dents = three_dents(rng, (-0.12, -0.03), (0.05, 0.02), (-0.02, 0.06))
    leaf = base.pose @ Pose.from_rpy((0, 0, 0.03), (0, 0, -proud))
    frame = base.pose @ Pose.from_rpy((0, 0, 0.03), (0, 0, 0))
    words = Lettering(0.03, -0.05, 'PUSH TO OPEN', 0.012, (0.2,) * 3)
    paint = Paint(marks=(words, *scratches(6, (-0.15, 0.15, -0.1, 0.1), seed(rng))))
    left = -0.05
    return scene(
        Panel(leaf, (left, 2, -2, 2), dents=dents[1:], paint=paint),
        Panel(frame, (-2, left - gap, -2, 2), dents=dents[:1], paint=paint),
    )


def taped(rng: np.random.Generator) -> KindScene:
    """Tape 0.1 to 0.3 mm thick and darker than the skin, across the view, dents on and beside."""
    base = skin(rng, dents=())
    pose = base.pose @ Pose.from_rpy((0, 0, rng.uniform(0, 3)), (0.0, 0.0, 0.0))
    dents = (
        by_contour(0.0, 0.0, 0.03, 0.03, 0.0008),
        by_contour(-0.06, 0.05, 0.03, 0.03, 0.0005, 0.0, Gaussian()),
    )
    thick = rng.uniform(0.0001, 0.0003)
    tape = pose @ Pose.from_rpy((0, 0, 0), (0, 0, -thick))
    return scene(
        Panel(tape, (-2, 2, -0.024, 0.026), dents=dents[:1], paint=Paint((0.5,) * 3)),
        Panel(pose, (-2, 2, -2, 2), dents=dents[1:]),
    )


def pane(rng: np.random.Generator) -> KindScene:
    """A window set 4 mm back in its frame, greyer than the skin."""
    base = skin(rng, dents=three_dents(rng, (-0.12, -0.03), (0.14, 0.05), (-0.1, 0.07)))
    hole = Opening(0.03, 0.0, 0.11, 0.14, rng.uniform(-0.2, 0.2), True)
    back = base.pose @ Pose.from_rpy((0, 0, 0), (0, 0, 0.004))
    behind = Panel(back, (-0.06, 0.12, -0.1, 0.1), paint=Paint((0.35,) * 3))
    return scene(replace(base, openings=(hole,)), behind)


def crease_row(rng: np.random.Generator) -> KindScene:
    """Creases along, across and aslant to the fringes over a row of flush rivets and dirt."""
    dents = tuple(
        by_contour(x, 0.0, 0.06, 0.009, 0.0006, turn, Valley(0.06))
        for x, turn in ((-0.1, math.pi / 2), (0.0, 0.0), (0.09, rng.uniform(0.4, 1.1)))
    )
    row = tuple(Rivet(-0.2 + 0.02 * i, 0.02) for i in range(21))
    paint = Paint(marks=(Dirt(0.1, seed=seed(rng)),))
    return scene(skin(rng, dents=dents, rivets=row, paint=paint))


def leading_edge(rng: np.random.Generator) -> KindScene:
    """A wing's leading edge of 0.15 m radius, dents at its middle and on its flanks."""
    dents = (
        by_contour(-0.05, -0.03, 0.03, 0.03, 0.001),
        by_contour(0.01, 0.03, 0.035, 0.025, 0.0005, rng.uniform(0, 3)),
        by_contour(0.055, -0.04, 0.02, 0.02, 0.00025, 0.0, Gaussian()),
    )
    pose = Pose.from_rpy((0.0, 0.0, rng.uniform(-0.5, 0.5)), (0, 0, 0.78))
    return scene(Panel(pose, (-2, 2, -2, 2), cylinder_radius=0.15, dents=dents))


PARTS: dict[str, Kind] = {
    'leading_edge': leading_edge,
    'plate_in_dent': plate_in_dent,
    'dents_on_rivets': on_a_row(Rivet),
    'dents_on_domes': on_a_row(DomedRivet),
    'dents_on_holes': on_a_row(MissingRivet),
    'pair_at_a_seam': pair_at_a_seam,
    'holes': holes,
    'inlet': inlet,
    'door': door,
    'taped': taped,
    'pane': pane,
    'crease_row': crease_row,
}
