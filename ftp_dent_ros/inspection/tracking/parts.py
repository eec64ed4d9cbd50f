"""Parts of a dent that one cloud divided, or cut, and others show whole: no dents of their own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ftp_dent_ros.inspection.tracking.pairing import Entry

# Of a dent's width: better than that a place must be known to lie in it, where poses alone tell.
_KNOWN = 0.25


def without_parts(entries: Sequence[Entry]) -> list[Entry]:
    """Entries but for those that lie in a dent which more clouds show whole than show them.

    A cloud at the rim of which a dent lies may take it for two that overlap. Each cloud's dents
    are other dents in the list, so that the second of them would be one too.
    """
    return [
        each
        for each in entries
        if not (each.dent.is_cut and any(_is_part(each, other) for other in entries))
    ]


def _is_part(each: Entry, other: Entry) -> bool:
    """Whether an entry that no cloud shows whole lies in another one."""
    dent = other.dent
    whole = sum(not sighting.dent.is_cut for sighting in other.listed.sightings)
    if (
        not (other.group == each.group or _is_known(each, other))
        or whole <= len(each.listed.sightings)
        or each.dent.kind == 'step'
        or dent.depth.value * each.dent.depth.value < 0
    ):
        return False
    away = each.dent.position - dent.position
    along, across = away @ dent.axis, away @ np.cross(dent.normal, dent.axis)
    # A step has no width, and nothing lies in it.
    return bool(np.hypot(2 * along / dent.length.value, 2 * across / dent.width.value) < 1)


def _is_known(each: Entry, other: Entry) -> bool:
    """Whether poses tell where one entry lies to the other, as those of a survey do."""
    spread = each.listed.position_covariance + other.listed.position_covariance
    return bool(np.sqrt(np.linalg.eigvalsh(spread)[-1]) < _KNOWN * other.dent.width.value)
