"""Poses of least robust squares, found step by step, none of which makes them fit worse.

Pairs are heard by Geman and McClure's function of their misfits: one that is far off costs no more
than one that is off, so what many agree on holds. First all pairs count alike, then the tolerance
falls until those that contradict the others hardly count: graduated non-convexity. A step that
would fit worse is made shorter, and a solution that fits worse than where it began is not taken:
whatever the pairs say, poses leave what the autopilot says no farther than the pairs are worth.
Source: H. Yang et al., IEEE Robotics and Automation Letters 5, 1127 (2020).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from ftp_dent_ros.survey.poses.link_terms import LinkTerms
from ftp_dent_ros.survey.poses.normal_equations import Array, NormalEquations
from ftp_dent_ros.survey.poses.stated_poses import StatedTerms
from ftp_dent_ros.survey.registration.twists import motions

#: Of squared errors by directions told: where a pair counts a quarter.
HALF = 16.0
# Steps, the step that is small enough, and the one from which on pairs are told apart: metres and
# radians. And the gain of a step, in squared standard deviations of all, that is none.
_STEPS, _DONE, _COARSE, _NO_GAIN = 40, 1e-7, 1e-4, 1e-4
# By which the tolerance falls from step to step.
_GRADUAL = 4.0
# A step is halved so often at most.
_HALVINGS = 12


@dataclass(frozen=True, eq=False)
class Errors:
    """How far poses are off what n links and m stated poses tell of them.

    Attributes
    ----------
    links, stated : ndarray, shape (n, 6) and (m, 6)
    misfits : ndarray, shape (n,)
        Squares of the links' errors, a direction told.
    of_stated : float
        Sum of squares of the stated poses' errors.
    """

    links: Array
    stated: Array
    misfits: Array
    of_stated: float


@dataclass(frozen=True, eq=False)
class Terms:
    """All that is told of the poses from number `fixed` on, gathered for a solution."""

    fixed: int
    count: int
    links: LinkTerms
    stated: StatedTerms

    def errors(self, turns: Array, places: Array) -> Errors:
        """How far poses are off what is told."""
        links, stated = self.links.errors(turns, places), self.stated.errors(turns, places)
        return Errors(
            links, stated, self.links.squares(links), float(self.stated.squares(stated).sum())
        )

    def equations(
        self,
        turns: Array,
        places: Array,
        errors: Errors,
        weights: Array,
        held: Mapping[int, Array] | None = None,
        with_common: bool = False,
    ) -> NormalEquations:
        """Normal equations, or those with one more unknown: what all clouds have in common.

        Some poses may be `held`: covariances, by the pose's number.
        """
        held = held or {}
        last = self.fixed + self.count if with_common else None
        equations = NormalEquations(self.fixed, self.count + with_common)
        self.links.add_to(equations, turns, places, errors.links, weights, last)
        self.stated.add_to(equations, errors.stated)
        for number, spread in held.items():
            information = np.linalg.inv(spread)[None].astype(float)
            equations.add([np.array([number])], [np.eye(6)[None]], np.zeros((1, 6)), information)
        return equations

    def cost(self, errors: Errors, tolerance: Array | float = 1.0) -> float:
        """Robust sum of squares."""
        heard = errors.misfits / (1 + errors.misfits / (HALF * tolerance))
        return float(self.links.told @ heard + errors.of_stated)


def solved(
    terms: Terms, turns: Array, places: Array, doubted: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Poses that agree best, from where they are; they fit no worse than that.

    Parameters
    ----------
    terms : Terms
    turns, places : ndarray, shape (all, 3, 3) and (all, 3)
        Of all poses.
    doubted : ndarray, shape (links,), bool
        Links that contradicted the others before: they count from the first step on by how they
        fit.

    Returns
    -------
    turns, places : ndarray, shape (all, 3, 3) and (all, 3)
    """
    found = _stepped(terms, turns, places, doubted, math.inf)
    if terms.cost(terms.errors(*found)) > terms.cost(terms.errors(turns, places)):
        return settled(terms, turns, places)
    return found


def settled(terms: Terms, turns: Array, places: Array) -> tuple[Array, Array]:
    """The same, but no pair that does not fit already pulls."""
    return _stepped(terms, turns, places, np.ones(len(terms.links), bool), 1.0)


def weights_of(misfits: Array, tolerance: Array | float = 1.0) -> Array:
    """Of pairs by squared errors a direction: of Geman and McClure's robust least squares."""
    return 1 / np.square(1 + misfits / (HALF * tolerance))


def factored(matrix: csc_matrix) -> Any:
    """Factors of a symmetric positive matrix: in an order that fills little of them."""
    return splu(
        matrix,
        permc_spec='MMD_AT_PLUS_A',
        diag_pivot_thresh=0.0,
        options={'SymmetricMode': True},
    )


def _stepped(
    terms: Terms, turns: Array, places: Array, doubted: NDArray[np.bool_], tolerance: float
) -> tuple[Array, Array]:
    """Poses after steps at tolerances that fall to 1, from a first one."""
    errors = terms.errors(turns, places)
    for _ in range(_STEPS):
        each = np.where(doubted, 1.0, tolerance)
        weights = weights_of(errors.misfits, each)
        equations = terms.equations(turns, places, errors, weights)
        step = -factored(equations.matrix()).solve(equations.gradient).reshape(-1, 6)
        before, gain = terms.cost(errors, each), 0.0
        for _ in range(_HALVINGS):
            there = _moved(turns, places, terms.fixed, step)
            off = terms.errors(*there)
            gain = before - terms.cost(off, each)
            if gain >= 0:
                (turns, places), errors = there, off
                break
            step /= 2
        size = np.abs(step).max()
        if tolerance == 1 and (size < _DONE or gain < _NO_GAIN):
            break
        if math.isinf(tolerance):
            if gain > _NO_GAIN and size > _COARSE:
                continue
            tolerance = float(errors.misfits[~doubted].max(initial=0.0)) / HALF
        tolerance = max(1.0, tolerance / _GRADUAL)
    return turns, places


def _moved(turns: Array, places: Array, fixed: int, step: Array) -> tuple[Array, Array]:
    """Poses after a step of those from a number on.

    Each moves along its screw, so that what slides or turns as one stays as it is, however far.
    """
    turns, places = turns.copy(), places.copy()
    at, turn = places[fixed:], step[:, 3:]
    off, shift = motions(np.concatenate([step[:, :3] - np.cross(turn, at), turn], axis=1))
    turns[fixed:] = off @ turns[fixed:]
    places[fixed:] = (off @ at[..., None])[..., 0] + shift
    return turns, places
