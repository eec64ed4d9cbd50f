"""What keeps its place in the picture while the skin moves is of a glass, not of the skin.

A drop or dirt on the camera's or the projector's glass bends or hides the fringes behind it, and
one photograph cannot tell that from a dent. In a flight a dent moves through the picture; a mark
on a glass stays. How often by chance alone dents of the skin come to the same place in the picture
follows from how many there are. Only what was seen with the camera elsewhere, beyond what the
poses' errors explain, counts: a drone that hovers decides nothing. What is seen inside a mark is
seen through it, and is not known to be on the skin: it counts where it is seen beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from ftp_dent_ros.dents.dent import MeasuredDent
from ftp_dent_ros.pose import Pose

# How far what is seen of one mark strays in the picture, radians: its sizes differ from cloud to
# cloud, and a mark on the projector's glass moves with the distance.
_STRAYS = 0.012
# So far the camera has moved at least if it is elsewhere, metres.
_ELSEWHERE = 0.03

Seen = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Spot:
    """A place in the picture at which something was seen.

    Attributes
    ----------
    bearing : ndarray, shape (2,)
        x and y over z in the camera's frame, the mean.
    sign : int
        1 inward, -1 outward.
    seen : frozenset of (int, int)
        Frame, and index in it, of all that was.
    cameras : tuple of ndarray
        Where the camera was, each elsewhere than the others.
    first : int
        How many places the camera had been at before.
    half : float
        Half the length of what was seen, the mean, radians.
    """

    bearing: NDArray[np.float64]
    sign: int
    seen: frozenset[Seen]
    cameras: tuple[NDArray[np.float64], ...]
    first: int
    half: float


@dataclass(frozen=True, eq=False)
class Glass:
    """All places in a flight's pictures at which something was seen.

    Attributes
    ----------
    spots : tuple of Spot
    cameras : tuple of ndarray
        Where the camera was, each elsewhere than the one before.
    shown : ndarray, shape (n, 5)
        Of all that was seen its frame, index in it, bearing (2) and half the length, radians.
    frames : int
        How many clouds were seen.
    """

    spots: tuple[Spot, ...] = ()
    cameras: tuple[NDArray[np.float64], ...] = ()
    shown: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 5)))
    frames: int = 0

    def with_frame(
        self,
        frame: int,
        dents: Sequence[MeasuredDent],
        pose: Pose,
        covariance: NDArray[np.float64],
    ) -> Glass:
        """The same with what another cloud shows, in the map, by the camera's stated pose."""
        spread = math.sqrt(max(float(np.linalg.eigvalsh(covariance[:3, :3])[-1]), 0.0))
        # Four standard deviations of a difference.
        gate = max(math.sqrt(2) * 4.0 * spread, _ELSEWHERE)
        here = pose.translation
        cameras = self.cameras
        if not cameras or np.linalg.norm(cameras[-1] - here) > gate:
            cameras = (*cameras, here)
        places = pose.inverse().apply(np.array([each.position for each in dents]).reshape(-1, 3))
        bearings = places[:, :2] / np.maximum(np.abs(places[:, 2:]), _ELSEWHERE)
        spots = list(self.spots)
        known = np.array([[*each.bearing, each.sign] for each in spots]).reshape(-1, 3)
        halves = [each.length.value / 2 for each in dents] / np.maximum(places[:, 2], _ELSEWHERE)
        for index, (dent, bearing) in enumerate(zip(dents, bearings, strict=True)):
            # What is so many times longer than wide may keep its middle in the picture as a seam
            # does that the drone flies along.
            if dent.kind == 'step' or not dent.length.value < 2.5 * dent.width.value:
                continue
            sign = 1 if dent.depth.value > 0 else -1
            # What has the other sign lies elsewhere.
            place = np.array([*bearing, sign])
            apart = np.linalg.norm(known - place, axis=1)
            at = int(apart.argmin()) if len(apart) else 0
            if not len(apart) or apart[at] > _STRAYS:
                at, known = len(spots), np.vstack([known, place])
                spots.append(Spot(bearing, sign, frozenset(), (), len(cameras), 0.0))
            spot, count = spots[at], len(spots[at].seen)
            elsewhere = all(np.linalg.norm(each - here) > gate for each in spot.cameras)
            spots[at] = replace(
                spot,
                bearing=(count * spot.bearing + bearing) / (count + 1),
                seen=spot.seen | {(frame, index)},
                cameras=(*spot.cameras, here) if elsewhere else spot.cameras,
                half=(count * spot.half + halves[index]) / (count + 1),
            )
        count = len(dents)
        new = np.column_stack([np.full(count, frame), np.arange(count), bearings, halves])
        return Glass(tuple(spots), cameras, np.vstack([self.shown, new]), self.frames + 1)

    @cached_property
    def of_marks(self) -> frozenset[Seen]:
        """Frame, and index in it, of all that is of a mark, or was seen through one."""
        found = set[Seen]()
        for mark in self.marks:
            # Inside the mark, and no longer than that.
            inside = np.linalg.norm(self.shown[:, 2:4] - mark.bearing, axis=1) < mark.half
            through = self.shown[inside & (self.shown[:, 4] < mark.half), :2]
            found |= mark.seen | {(int(of_frame), int(index)) for of_frame, index in through}
        return frozenset(found)

    @cached_property
    def marks(self) -> tuple[Spot, ...]:
        """Places at which chance alone would not have shown so much."""
        return tuple(each for each in self.spots if self._is_mark(each))

    def _is_mark(self, spot: Spot) -> bool:
        hits, places = len(spot.cameras), len(self.cameras) - spot.first + 1
        # Part of the camera's places at which a mark is seen, at least.
        if hits < max(3, 0.5 * places):
            return False
        # The smallest picture of which the chance is reckoned, square radians.
        picture = max(float(np.prod(np.ptp(self.shown[:, 2:4], axis=0))), 0.03)
        others = (len(self.shown) - len(spot.seen)) / self.frames
        chance = min(others * math.pi * _STRAYS**2 / picture, 0.9)
        by_chance = float(bdtrc(hits - 2, max(places, hits) - 1, chance))
        # Marks that chance alone may tell, a flight.
        return by_chance * len(self.spots) < 1e-5


def sentence(marks: Sequence[Spot]) -> str:
    """Of marks, for people; empty if there is none."""
    if not marks:
        return ''
    many = 'places keep their' if len(marks) > 1 else 'place keeps its'
    return (
        f'{len(marks)} {many} form in the picture while the skin moves on, as drops or dirt on '
        'the glass of camera or projector do: left out of the list, with what was seen through '
        'them; clean both, and fly this again'
    )
