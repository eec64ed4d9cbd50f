"""The list of dents of a flight: corrected with its poses, kept on disk if it is told where."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.dents.dent import MeasuredDent, dent_from_plain, dent_to_plain
from ftp_dent_ros.dents.dent_list import DentList
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.errors import ConfigurationError, PoseError
from ftp_dent_ros.pose import IDENTITY, Pose

# A state of the list is kept before every so many frames: to begin a correction there.
_EVERY = 8

# What a dent has to be off by for its frame to be placed anew: no pose is better, metres.
_OFF = 1e-3


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
                if isinstance(item, PoseCorrection):
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
        entry = ListedCloud(frame_id, stamp_ns, tuple(dents), pose, covariance)
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
            self._journal.append(PoseCorrection(corrected))
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

    def snapshot(self) -> DentList:
        """The list as it is, which later changes leave alone; made at once, however long it is."""
        return self._list.copy()

    def _forget(self) -> None:
        self._list = DentList()
        self._taken: list[ListedCloud] = []
        # Its states before some clouds, and how all has been moved since.
        self._before: list[tuple[DentList, Pose]] = []
        self.frame_id, self.stamp_ns = '', 0

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
                for move in (IDENTITY, common_move(self._taken, there))
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

    def _add(self, entry: ListedCloud) -> bool:
        before = None if len(self._taken) % _EVERY else self._list.copy()
        number = len(self._taken) + 1
        words = entry.dents, entry.pose, entry.covariance
        if not self._list.add(number, *words, stamp_ns=entry.stamp_ns):
            return False
        if before is not None:
            self._before.append((before, IDENTITY))
        self._taken.append(entry)
        return True

    def _take(self, entry: ListedCloud) -> None:
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


@dataclass(frozen=True, eq=False)
class ListedCloud:
    """What one frame added.

    Attributes
    ----------
    frame_id : str
        Of the list.
    stamp_ns : int
    dents : tuple of MeasuredDent
        In that frame, where the pose puts them.
    pose : Pose
        Of the camera.
    covariance : ndarray, shape (6, 6)
    """

    frame_id: str
    stamp_ns: int
    dents: tuple[MeasuredDent, ...]
    pose: Pose
    covariance: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PoseCorrection:
    """Where cameras are found to have been, after all.

    Attributes
    ----------
    poses : mapping of int to Pose
        By the stamps of their frames, in the list's frame.
    """

    poses: Mapping[int, Pose]


class Journal:
    """The entries of a list, in a file.

    An entry is on disk before `append` returns. One that a crash has cut short is left out.

    Parameters
    ----------
    path : path-like
        Made if it is not there.

    Raises
    ------
    ConfigurationError
        The file cannot be read or written, or is something else.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.touch()
            lines = self.path.read_bytes().split(b'\n')
        except OSError as reason:
            raise ConfigurationError(
                f'{self.path}: the list cannot be kept there ({reason.strerror}): '
                'name another file'
            ) from None
        self._whole = lines[:-1]
        if lines[-1]:
            # Cut short: the next entry must not be joined to it.
            os.truncate(self.path, sum(len(line) + 1 for line in self._whole))

    def entries(self) -> Iterator[ListedCloud | PoseCorrection]:
        """What the file held when it was opened, in its order.

        Raises
        ------
        ConfigurationError
            A line is no entry.
        """
        return (self._read(number, line) for number, line in enumerate(self._whole, start=1))

    def _read(self, number: int, line: bytes) -> ListedCloud | PoseCorrection:
        try:
            record = json.loads(line)
            return _correction(record) if 'corrected' in record else _entry(record)
        except (ValueError, KeyError, TypeError):
            raise ConfigurationError(
                f'{self.path}: line {number} is no entry of a list of dents: '
                'name another file, or remove this one'
            ) from None

    def append(self, item: ListedCloud | PoseCorrection) -> None:
        """Write what is new; raises OSError if it cannot be."""
        line = json.dumps(_record(item)).encode() + b'\n'
        with self.path.open('ab') as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())

    def clear(self) -> None:
        """Forget all; raises OSError if it cannot be."""
        os.truncate(self.path, 0)


def _record(item: ListedCloud | PoseCorrection) -> dict[str, Any]:
    if isinstance(item, PoseCorrection):
        corrected = [{'stamp_ns': stamp, **_plain(pose)} for stamp, pose in item.poses.items()]
        return {'corrected': corrected}
    return {
        'frame_id': item.frame_id,
        'stamp_ns': item.stamp_ns,
        **_plain(item.pose),
        'covariance': np.ravel(item.covariance).tolist(),
        'dents': [dent_to_plain(dent) for dent in item.dents],
    }


def _plain(pose: Pose) -> dict[str, Any]:
    return {
        'position': pose.translation.tolist(),
        'orientation_xyzw': pose.quaternion.tolist(),
    }


def _pose(record: dict[str, Any]) -> Pose:
    return Pose.from_quaternion(record['orientation_xyzw'], record['position'])


def _correction(record: dict[str, Any]) -> PoseCorrection:
    return PoseCorrection({int(each['stamp_ns']): _pose(each) for each in record['corrected']})


def _entry(record: dict[str, Any]) -> ListedCloud:
    return ListedCloud(
        frame_id=str(record['frame_id']),
        stamp_ns=int(record['stamp_ns']),
        dents=tuple(dent_from_plain(each) for each in record['dents']),
        pose=_pose(record),
        covariance=np.array(record['covariance'], float).reshape(6, 6),
    )


def is_off(entry: ListedCloud, pose: Pose) -> bool:
    """Whether another pose puts a cloud's dents elsewhere."""
    move = pose @ entry.pose.inverse()
    places = _places([entry])
    return bool((np.linalg.norm(move.apply(places) - places, axis=1) > _OFF).any())


def placed(entry: ListedCloud, pose: Pose) -> ListedCloud:
    """What a cloud shows, where another pose puts it."""
    if pose is entry.pose:
        return entry
    move = pose @ entry.pose.inverse()
    dents = tuple(dent.transformed(move) for dent in entry.dents)
    return replace(entry, dents=dents, pose=pose)


def _places(entries: Sequence[ListedCloud]) -> NDArray[np.float64]:
    """Of all dents, shape (n, 3)."""
    return np.array([dent.position for each in entries for dent in each.dents]).reshape(-1, 3)


def common_move(before: Sequence[ListedCloud], after: Sequence[ListedCloud]) -> Pose:
    """The move that carries all dents as one, in the mean."""
    old, new = _places(before), _places(after)
    middle, there = old.mean(axis=0), new.mean(axis=0)
    # A turn that nothing tells is none.
    held = 1e-3 * np.eye(3)
    turn, _ = Rotation.align_vectors(
        np.concatenate([new - there, held]), np.concatenate([old - middle, held])
    )
    return Pose(turn, there - turn.apply(middle))


def unmoved(before: Sequence[ListedCloud], after: Sequence[ListedCloud], move: Pose) -> int:
    """How many of the first clouds a move of all puts where they are to be."""
    for index, (old, new) in enumerate(zip(before, after, strict=True)):
        off = move.apply(_places([old])) - _places([new])
        if (np.linalg.norm(off, axis=1) > _OFF).any():
            return index
    return len(before)
