"""How unsure a cloud's place is, seen from an earlier one, before they are laid on each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.survey.poses.pose_graph import PoseGraph
from ftp_dent_ros.survey.poses.stated_poses import relative_doubt

# Clouds before the newest, and about another, by which the doubt of these two is known.
_NEARBY = 4
# Of a cloud's place seen from the one before, where no autopilot tells it: metres, radians.
_BLIND = np.diag([0.08**2] * 3 + [0.03**2] * 3)


def doubt_by_links(graph: PoseGraph, first: int, second: int) -> NDArray[np.float64]:
    """Covariance of the second camera's place seen from the first, by all that joins them nearby.

    Along the first camera's axes, about the second camera, shape (6, 6).

    Parameters
    ----------
    graph : PoseGraph
    first, second : int
        Numbers of the clouds; the second is joined already.
    """
    links = graph.links
    near = {first, *range(max(0, second - _NEARBY), second + 1)}
    start = graph.first_link(max(0, second - _NEARBY))
    near |= {link.first for link in links[start:] if abs(link.first - first) <= _NEARBY}
    numbers = sorted(near)
    part = graph.part(numbers)
    at = numbers.index(first)
    covariance = part.covariances(anchor=at, only=[numbers.index(second)])[0]
    turn = np.kron(np.eye(2), graph.poses[first].rotation.as_matrix())
    return turn.T @ covariance @ turn


def doubt_by_autopilot(graph: PoseGraph, first: int, second: int) -> NDArray[np.float64]:
    """The same by the autopilot alone, or by how far a drone flies where it tells nothing."""
    a, b = graph.nodes[first], graph.nodes[second]
    if a.covariance is None or b.covariance is None:
        return _BLIND * max(1, min(second - first, 3))
    return relative_doubt(a, b, graph.poses[first], graph.poses[second])
