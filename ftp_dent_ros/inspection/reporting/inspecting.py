"""A cloud inspected for a report, in whatever process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.inspection.dent import Inspection, MeasuredDent
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.inspection.tracking.repeatability import halves

Inspect = Callable[..., Inspection]


@dataclass(frozen=True, eq=False)
class Task:
    """A cloud to inspect: plain data, that another process can be given.

    Attributes
    ----------
    cloud : Cloud
    viewpoint : array_like, shape (3,)
        From where it was seen, in its own frame, metres.
    in_halves : bool
        Whether its halves are measured too, for the gauge study.
    """

    cloud: Cloud
    viewpoint: ArrayLike
    in_halves: bool


@dataclass(frozen=True, eq=False)
class Inspected:
    """What came of a task.

    Attributes
    ----------
    found : Inspection, optional
        In the cloud's own frame; None if it cannot be inspected.
    again : tuple of tuples of MeasuredDent
        Of each of its halves.
    reason : str
        Why it cannot be inspected.
    """

    found: Inspection | None = None
    again: tuple[tuple[MeasuredDent, ...], ...] = ()
    reason: str = ''


def inspected(inspect: Inspect, settings: Settings, task: Task) -> Inspected:
    """Inspect a cloud and, if that is asked for, its halves."""
    try:
        found = inspect(task.cloud, settings=settings, viewpoint=task.viewpoint)
        again = []
        for half in halves(task.cloud) if task.in_halves else ():
            other = inspect(half, settings=settings, viewpoint=task.viewpoint)
            again.append((*other.dents, *other.others))
    except FtpDentError as error:
        return Inspected(reason=str(error))
    except Exception as error:
        # One cloud must not cost the report on all the others.
        return Inspected(
            reason='could not be inspected, by a defect of the software '
            f'({type(error).__name__}: {error}): report it with the cloud'
        )
    return Inspected(found, tuple(again))
