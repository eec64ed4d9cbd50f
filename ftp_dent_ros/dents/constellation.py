"""Which of the dents that are known a frame shows again, by where they lie to each other.

Within a frame, places are known to a fraction of a millimetre to each other; the pose that puts
them into the map only to centimetres. So a frame is moved as a whole, to where most of its dents
lie on known ones, and how likely that is by chance decides whether they are the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from scipy.special import logsumexp

from ftp_dent_ros.dents.dent import MeasuredDent, tangent_axes
from ftp_dent_ros.dents.sightings import agreement, assigned, centre_deviations, coincidence
from ftp_dent_ros.pose import IDENTITY, Pose
from ftp_dent_ros.rigid import about, fit_move

#: Standard deviations that a pose may be off: chi of three axes that holds 99.7 %.
GATE = 3.75
# Standard deviations that a place may be off within a frame.
_NEAR = 4.0
# Moves that are tried, at most.
_TRIED = 400

Field = NDArray[np.float64]

#: Part of a pose's error that the frame before had too: estimators drift, they do not jump.
SHARED = 0.8


def find_match(
    seen: Sequence[MeasuredDent],
    known: Sequence[MeasuredDent],
    pivot: Field,
    covariance: Field,
) -> tuple[float, Pose] | None:
    """The move that puts a frame's dents onto known ones, likelier than chance and than others.

    Parameters
    ----------
    seen, known : sequence of MeasuredDent
        In one frame of reference.
    pivot : ndarray, shape (3,)
        Place of the frame's pose, about which its error turns.
    covariance : ndarray, shape (6, 6)
        Of the error, as in geometry_msgs/PoseWithCovariance.

    Returns
    -------
    odds : float
        Natural logarithm, for this move against none.
    move : Pose
        From where the frame's pose has its dents to where they lie. None at all of no such move.
    """
    if not len(seen) or not len(known):
        return None
    places = np.stack([dent.position for dent in seen])
    normal = np.mean([dent.normal for dent in seen], axis=0)
    # Moves are looked for along the skin's tangent plane at the frame.
    middle, axes = places.mean(axis=0), tangent_axes(normal)
    there = np.stack([dent.position for dent in known])
    turned = about(middle - pivot)
    spread = axes @ (turned @ covariance @ turned.T) @ axes.T
    shift, turn = spread[:2, :2] + 1e-12 * np.eye(2), float(normal @ covariance[3:, 3:] @ normal)
    turn = math.sqrt(turn / (normal @ normal)) + 1e-6
    a, b = (places - middle) @ axes.T, (there - middle) @ axes.T
    offset = b[None, :, :2] - a[:, None, :2]
    far = np.einsum('ijk,kl,ijl->ij', offset, np.linalg.inv(shift), offset)
    reach = np.linalg.norm(a[:, :2], axis=1)[:, None] * GATE * turn
    slack = (reach / math.sqrt(np.linalg.eigvalsh(shift)[0])) if len(a) > 1 else 0.0
    possible = np.sqrt(far) < GATE + slack
    # What stands out and what is pushed in lie at about one height.
    possible &= np.abs(b[None, :, 2] - a[:, None, 2]) < GATE * math.sqrt(spread[2, 2]) + 0.01
    # All else is of the known ones nearby: it costs the same however many there are.
    near = np.flatnonzero(possible.any(axis=0))
    if not len(near):
        return None
    nearby = [known[int(k)] for k in near]
    there, b, possible = there[near], b[near], possible[:, near]
    # Twice the logarithm of how much less likely the sizes are of one dent than of two.
    agree = agreement(seen, nearby) - 2 * coincidence(seen, nearby, known)
    possible &= np.isfinite(agree)
    # Sightings of what the frame cuts have their centre anywhere.
    whole = np.array([not d.is_cut for d in seen])[:, None] & [not d.is_cut for d in nearby]
    place = centre_deviations(seen, nearby)
    rows, columns = np.nonzero(possible & whole)
    judged: list[tuple[float, tuple[tuple[int, int], ...]]] = []
    tried: set[tuple[tuple[int, int], ...]] = set()
    for angle, move in _moves(a, b, rows, columns, place, turn):
        found = _judged(a, b, agree, possible, place, angle, move, shift, turn, tried)
        if found is not None:
            judged.append(found)
    odds, pairs = max(judged, key=lambda each: each[0], default=(0.0, ()))
    # Natural logarithm of the odds from which on a match is believed: against none, and against
    # all others that put every dent elsewhere (20 to 1).
    if odds <= 0.0:
        return None
    rivals = [other for other, others in judged if not set(others) & set(pairs)]
    if rivals and odds - logsumexp(rivals) < 3.0:
        return None
    i, j = np.array(pairs).T
    return odds, fit_move(places[i], there[j], place[i, j], pivot, covariance)


def _moves(a, b, rows, columns, place, turn):
    """Turns and shifts that bring one or two dents onto known ones, the safest first."""
    first, second = np.triu_indices(len(rows), 1)
    i, j, k, m = rows[first], columns[first], rows[second], columns[second]
    ours, theirs = a[k, :2] - a[i, :2], b[m, :2] - b[j, :2]
    length, other = np.linalg.norm(ours, axis=1), np.linalg.norm(theirs, axis=1)
    tolerance = _NEAR * np.hypot(place[i, j], place[k, m])
    good = (i != k) & (j != m) & (np.abs(length - other) < tolerance)
    cross = ours[:, 0] * theirs[:, 1] - ours[:, 1] * theirs[:, 0]
    angle = np.arctan2(cross, (ours * theirs).sum(axis=1))
    good &= np.abs(angle) < GATE * turn + tolerance / np.maximum(length, 1e-3)
    moves = []
    for at in np.flatnonzero(good)[np.argsort(-length[good], kind='stable')][:_TRIED]:
        middle = (a[i[at], :2] + a[k[at], :2]) / 2
        there = (b[j[at], :2] + b[m[at], :2]) / 2
        moves.append((float(angle[at]), there - _turned(middle, angle[at])))
    alone = b[columns[:_TRIED], :2] - a[rows[:_TRIED], :2]
    return moves + [(0.0, shift) for shift in alone]


def _judged(a, b, agree, possible, place, angle, move, shift, turn, tried):
    """Odds and pairs of a move, fitted to all that it brings together; none that is `tried`."""
    for attempt in range(2):
        off = b[None, :, :2] - (_turned(a[:, :2], angle) + move)[:, None]
        square = (off**2).sum(axis=-1) / place**2
        i, j = assigned(np.where(possible & (square < 2 * _NEAR**2), square + agree, np.inf))
        if not len(i):
            return None
        pairs = tuple(zip(i.tolist(), j.tolist(), strict=True))
        if not attempt:
            # All that follows depends on the pairs alone.
            if pairs in tried:
                return None
            tried.add(pairs)
        weight = place[i, j] ** -2.0
        angle, move = _fitted(a[i, :2], b[j, :2], weight, shift, turn)
    off = b[j, :2] - (_turned(a[i, :2], angle) + move)
    # Square metres that a frame's dents are counted on, at least.
    density = len(a) / max(_area(a), 0.05)
    odds = -float((weight * (off**2).sum(axis=1) + agree[i, j]).sum()) / 2
    odds -= float(np.log(2 * math.pi * density / weight).sum())
    # What the pose says of the move, and what the fit takes of the places' freedom.
    odds -= float(move @ np.linalg.solve(shift, move)) / 2 + (angle / turn) ** 2 / 2
    odds -= 0.5 * math.log(np.linalg.det(np.eye(2) + shift * weight.sum()))
    lever = float((weight * (a[i, :2] ** 2).sum(axis=1)).sum())
    odds -= 0.5 * math.log(1 + turn**2 * lever)
    return odds, pairs


def _fitted(ours, theirs, weight, shift, turn):
    """Small turn and shift by least squares, with the pose's as a prior."""
    x, y = ours.T
    along_x, along_y = (theirs - ours).T
    normal = np.zeros((3, 3))
    normal[0, 0] = turn**-2 + weight @ (x * x + y * y)
    normal[1:, 1:] = np.linalg.inv(shift) + weight.sum() * np.eye(2)
    normal[0, 1:] = normal[1:, 0] = -(weight @ y), weight @ x
    right = np.array([weight @ (x * along_y - y * along_x), weight @ along_x, weight @ along_y])
    solution = np.linalg.solve(normal, right)
    return float(solution[0]), solution[1:]


def _near(seen: Sequence[MeasuredDent], where: Field, pivot: Field, covariance: Field) -> Field:
    """Mask of the places that `find_match` may pair with anything: by somewhat too many."""
    if not len(seen) or not len(where):
        return np.zeros(len(where), bool)
    places = np.stack([dent.position for dent in seen])
    middle = places.mean(axis=0)
    turned = about(middle - pivot)
    least, _, most = np.sqrt(np.linalg.eigvalsh(turned @ covariance @ turned.T).clip(1e-12))
    turn = math.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1]) + 1e-6
    extent = float(np.linalg.norm(places - middle, axis=1).max())
    reach = 1.01 * GATE * (2 * most + extent * turn * most / least) + 0.01
    return cdist(where, places).min(axis=1) < reach


def _turned(places: Field, angle: float) -> Field:
    c, s = math.cos(angle), math.sin(angle)
    return places @ np.array([[c, s], [-s, c]])


def _area(places: Field) -> float:
    """Of the box around them and half a spacing beyond, square metres."""
    sides = np.ptp(places[:, :2], axis=0)
    spacing = math.sqrt(max(sides[0] * sides[1], 1e-4) / len(places))
    return float((sides[0] + spacing) * (sides[1] + spacing))


def groups_shown(
    dents: Sequence[MeasuredDent],
    known: Mapping[int, Sequence[MeasuredDent]],
    pivot: NDArray[np.float64],
    doubt: NDArray[np.float64],
    expected: Pose,
) -> list[tuple[int, Pose]]:
    """Groups that a frame shows, and the move onto each, the surest first.

    Parameters
    ----------
    dents : sequence of MeasuredDent
        Of the frame, where its pose puts them.
    known : mapping of int to sequence of MeasuredDent
        The dents of each group.
    pivot : ndarray, shape (3,)
        What the frame turns about, metres.
    doubt : ndarray, shape (6, 6)
        Covariance of the frame's pose, as `DentList.add` takes it.
    expected : Pose
        Where the frame lies if its pose errs as the one before did.
    """
    # This pose errs nearly as the one before; or both err, each by itself.
    ways = (expected, (1 - SHARED**2) * doubt), (IDENTITY, 2 * doubt)
    where = np.array([dent.position for each in known.values() for dent in each]).reshape(-1, 3)
    of_group = np.repeat(list(known), [len(each) for each in known.values()])
    found: dict[int, tuple[float, Pose]] = {}
    for start, spread in ways:
        moved = [dent.transformed(start) for dent in dents]
        near = _near(moved, where, pivot, spread)
        for group in np.unique(of_group[near]).tolist():
            match = find_match(moved, known[group], pivot, spread)
            if match is not None and (group not in found or match[0] > found[group][0]):
                found[group] = match[0], match[1] @ start
    surest = sorted(found.items(), key=lambda item: (-item[1][0], item[0]))
    return [(group, move) for group, (_, move) in surest]
