"""The list of dents of a flight: corrected with its poses, kept on disk if it is told where."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError, PoseError
from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.observation import SAME
from ftp_dent_ros.inspection.tracking.corrections import common_move, is_off, placed, unmoved
from ftp_dent_ros.inspection.tracking.dent_list import DentList
from ftp_dent_ros.inspection.tracking.glass import Spot
from ftp_dent_ros.inspection.tracking.journal import Correction, Entry, Journal
from ftp_dent_ros.inspection.tracking.sightings import ListedDent
from ftp_dent_ros.pose import Pose

# A state of the list is kept before every so many frames: to begin a correction there.
_EVERY = 8


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
            poses: dict[int, Pose] = {}
            for item in self._journal.entries() if self._journal else ():
                if isinstance(item, Correction):
                    poses |= item.poses
                else:
                    self._take(item)
            self._replace(poses)
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

    def correct(self, frame_id: str, poses: Mapping[int, Pose]) -> bool:
        """Put clouds where their cameras are found to have been; whether that changes anything.

        What moves as one is moved, and the list made again from the first cloud on that lies
        elsewhere among those before it. What begins a dent keeps its number, and the number of
        what turns out to be another dent is gone.

        Parameters
        ----------
        frame_id : str
            Frame of the poses.
        poses : mapping of int to Pose
            Of the cameras, by the clouds' stamps; others are left alone.

        Raises
        ------
        PoseError
            The frame is another one than the list's.
        OSError
            It cannot be kept on disk; the list is corrected all the same.
        """
        if self.frame_id and frame_id != self.frame_id:
            raise _other_frame('the path is', frame_id, self.frame_id)
        corrected = self._replace(poses)
        if corrected and self._journal:
            self._journal.append(Correction(corrected))
        return bool(corrected)

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
        self._taken: list[Entry] = []
        # Its states before some clouds, and how all has been moved since.
        self._before: list[tuple[DentList, Pose]] = []
        self.frame_id, self.stamp_ns = '', 0

    @property
    def glass(self) -> tuple[Spot, ...]:
        """Marks on a glass of the camera or the projector, which are not in the list."""
        return self._list.glass

    @property
    def clouds(self) -> int:
        """How many clouds the list is made of."""
        return len(self._taken)

    def _replace(self, poses: Mapping[int, Pose]) -> dict[int, Pose]:
        """Place clouds anew; the poses that are used of those given."""
        used = {
            entry.stamp_ns: poses[entry.stamp_ns]
            for entry in self._taken
            if entry.stamp_ns in poses and is_off(entry, poses[entry.stamp_ns])
        }
        if not used:
            return used
        there = [placed(entry, used.get(entry.stamp_ns, entry.pose)) for entry in self._taken]
        # Either the first ones stay where they are, or all move as one.
        move, same = max(
            (
                (move, unmoved(self._taken, there, move))
                for move in (SAME, common_move(self._taken, there))
            ),
            key=lambda each: each[1],
        )
        if same == len(there):
            self._list = self._list.moved(move)
            self._before = [(each, move @ moved) for each, moved in self._before]
            self._taken = there
            return used
        first = same // _EVERY
        start, moved = self._before[first]
        self._list = start.moved(move @ moved).numbered_as(self._list)
        self._before = [(each, move @ moved) for each, moved in self._before[:first]]
        self._taken = there[: first * _EVERY]
        for entry in there[first * _EVERY :]:
            self._add(entry)
        return used

    def _add(self, entry: Entry) -> bool:
        before = None if len(self._taken) % _EVERY else self._list.copy()
        number = len(self._taken) + 1
        words = entry.dents, entry.pose, entry.covariance
        if not self._list.add(number, *words, stamp_ns=entry.stamp_ns):
            return False
        if before is not None:
            self._before.append((before, SAME))
        self._taken.append(entry)
        return True

    def _take(self, entry: Entry) -> None:
        if self.frame_id and entry.frame_id != self.frame_id:
            raise _other_frame('the cloud is put', entry.frame_id, self.frame_id)
        if not self._add(entry):
            raise PoseError(
                f'the cloud of {entry.stamp_ns / 1e9:.3f} s is in the list already: publish each '
                'once, with the time of its exposure',
                'already seen',
            )
        self.frame_id, self.stamp_ns = entry.frame_id, entry.stamp_ns


def _other_frame(what: str, frame_id: str, own: str) -> PoseError:
    return PoseError(
        f'{what} in the frame {frame_id!r}, the list is in {own!r}: publish all in one, or take '
        'the list first',
        'wrong frame',
    )
