"""The list of dents of a flight, kept on disk if it is told where."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError, PoseError
from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.tracking.dent_list import DentList
from ftp_dent_ros.inspection.tracking.journal import Entry, Journal
from ftp_dent_ros.inspection.tracking.sightings import ListedDent
from ftp_dent_ros.pose import Pose


class KeptList:
    """A `DentList` in one frame of reference, whose clouds are told apart by their stamps.

    Parameters
    ----------
    path : path-like, optional
        File that holds it over a restart; what is there is read.

    Attributes
    ----------
    frame_id : str
        Of the list; empty while it is.
    clouds : int
        How many it is made of.
    stamp_ns : int
        Of the last one.

    Raises
    ------
    ConfigurationError
        The file cannot be read or written, or is something else.
    """

    def __init__(self, path: str | os.PathLike[str] | None = None) -> None:
        self._journal = Journal(path) if path else None
        self._forget()
        try:
            for entry in self._journal.entries() if self._journal else ():
                self._take(entry)
        except PoseError as error:
            raise ConfigurationError(f'{path}: {error}') from None

    def add(
        self,
        frame_id: str,
        stamp_ns: int,
        dents: Sequence[MeasuredDent],
        pose: Pose,
        covariance: NDArray[np.float64],
    ) -> None:
        """Add what one cloud shows.

        Parameters
        ----------
        frame_id : str
            Frame of the dents and of the pose.
        stamp_ns : int
            Of the exposure.
        dents : sequence of MeasuredDent
        pose : Pose
            Of the camera.
        covariance : ndarray, shape (6, 6)

        Raises
        ------
        PoseError
            The frame is another one than the list's, or the stamp is one that was added.
        OSError
            It cannot be kept on disk; it is in the list all the same.
        """
        entry = Entry(frame_id, stamp_ns, tuple(dents), pose, covariance)
        self._take(entry)
        if self._journal:
            self._journal.append(entry)

    def clear(self) -> None:
        """Forget all, on disk too; raises OSError if that cannot be."""
        self._forget()
        if self._journal:
            self._journal.clear()

    @property
    def entries(self) -> tuple[ListedDent, ...]:
        """Every dent and whatever else was found, with its clearance."""
        return self._list.entries

    def _forget(self) -> None:
        self._list = DentList()
        self.frame_id, self.stamp_ns, self.clouds = '', 0, 0

    def _take(self, entry: Entry) -> None:
        if self.frame_id and entry.frame_id != self.frame_id:
            raise PoseError(
                f'the cloud is put into the frame {entry.frame_id!r}, the list is in '
                f'{self.frame_id!r}: publish all in one, or take the list first',
                'wrong frame',
            )
        added = self._list.add(
            self.clouds + 1,
            entry.dents,
            entry.pose,
            entry.covariance,
            stamp_ns=entry.stamp_ns,
        )
        if not added:
            raise PoseError(
                f'the cloud of {entry.stamp_ns / 1e9:.3f} s is in the list already: publish each '
                'once, with the time of its exposure',
                'already seen',
            )
        self.frame_id, self.stamp_ns = entry.frame_id, entry.stamp_ns
        self.clouds += 1
