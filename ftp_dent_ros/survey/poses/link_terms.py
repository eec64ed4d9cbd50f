"""What pairs of clouds tell of their poses, as terms of their normal equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.survey.poses.normal_equations import Array, NormalEquations, squares
from ftp_dent_ros.survey.registration.relative_pose import RelativePose
from ftp_dent_ros.survey.registration.twists import changes, crossed, twists


@dataclass(frozen=True, eq=False)
class Link:
    """A relative pose between two clouds, the second's seen from the first."""

    first: int
    second: int
    relative: RelativePose

    @cached_property
    def turn(self) -> Array:
        """Of the second seen from the first, shape (3, 3)."""
        return self.relative.pose.rotation.as_matrix()


@dataclass(frozen=True, eq=False)
class LinkTerms:
    """Links in arrays.

    Attributes
    ----------
    number, first, second : ndarray, shape (n,), int
        Of the link, and of its poses.
    turn, shift : ndarray, shape (n, 3, 3) and (n, 3)
        Of the second seen from the first.
    centre : ndarray, shape (n, 3)
    information : ndarray, shape (n, 6, 6)
    told : ndarray, shape (n,)
        Directions.
    common : ndarray, shape (n, 6, 6)
        How twists change with the errors that all clouds have in common.
    """

    number: NDArray[np.intp]
    first: NDArray[np.intp]
    second: NDArray[np.intp]
    turn: Array
    shift: Array
    centre: Array
    information: Array
    told: Array
    common: Array

    @classmethod
    def of(cls, links: Sequence[Link], numbers: Sequence[int]) -> LinkTerms:
        """Terms of links, and the links' numbers."""
        relative = [link.relative for link in links]
        count = len(links)
        return cls(
            np.array(numbers, np.intp),
            np.array([link.first for link in links], np.intp),
            np.array([link.second for link in links], np.intp),
            np.array([link.turn for link in links]).reshape(count, 3, 3),
            np.array([each.pose.translation for each in relative]).reshape(count, 3),
            np.array([each.centre for each in relative]).reshape(count, 3),
            np.array([each.information for each in relative]).reshape(count, 6, 6),
            np.array([each.told for each in relative], float),
            np.array([each.common for each in relative]).reshape(count, 6, 6),
        )

    def __len__(self) -> int:
        return len(self.number)

    def errors(self, turns: Array, places: Array) -> Array:
        """Twists from what links tell to where poses are, shape (n, 6).

        Parameters
        ----------
        turns, places : ndarray, shape (all, 3, 3) and (all, 3)
            Of all poses.
        """
        back = np.swapaxes(turns[self.first], 1, 2)
        off = back @ turns[self.second] @ np.swapaxes(self.turn, 1, 2)
        seen = _turned(back, places[self.second] - places[self.first])
        shift = seen + _turned(off, self.centre - self.shift) - self.centre
        return twists(off, shift)

    def misfits(self, turns: Array, places: Array) -> Array:
        """Squared errors by what links state, a direction told, shape (n,)."""
        return self.squares(self.errors(turns, places))

    def squares(self, errors: Array) -> Array:
        """The same of errors of shape (n, 6)."""
        return squares(errors, self.information) / self.told

    def add_to(
        self,
        equations: NormalEquations,
        turns: Array,
        places: Array,
        errors: Array,
        weights: Array,
        common: int | None = None,
    ) -> None:
        """Add the links at poses, where they have these errors, weighted, to normal equations.

        Parameters
        ----------
        equations : NormalEquations
        turns, places, errors, weights : ndarray, shape (all, 3, 3), (all, 3), (n, 6) and (n,)
        common : int, optional
            Number of the unknown of what all clouds have in common, beyond the poses.
        """
        back = np.swapaxes(turns[self.first], 1, 2)
        centre = places[self.first] + _turned(turns[self.first], self.centre)
        change = changes(errors)
        moves = []
        for pose in (self.first, self.second):
            # A turn of a camera shifts what lies at the end of the arm.
            move = np.zeros((len(self), 6, 6))
            move[:, :3, :3] = move[:, 3:, 3:] = back
            move[:, :3, 3:] = -back @ crossed(centre - places[pose])
            moves.append(change @ move)
        information = weights[:, None, None] * self.information
        unknowns, slopes = [self.first, self.second], [-moves[0], moves[1]]
        if common is not None:
            unknowns.append(np.full(len(self), common))
            slopes.append(self.common)
        equations.add(unknowns, slopes, errors, information)


def _turned(turns: Array, vectors: Array) -> Array:
    return (turns @ vectors[..., None])[..., 0]
