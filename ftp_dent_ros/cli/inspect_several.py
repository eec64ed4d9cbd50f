"""Many inputs of ``ftp-dent inspect``, side by side, each with a report of its own."""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ftp_dent_ros.cli.inspection_request import Request, report_of
from ftp_dent_ros.errors import ConfigurationError, FtpDentError
from ftp_dent_ros.files import content_id, find
from ftp_dent_ros.fleet import begin, finish, is_made_of, made_of
from ftp_dent_ros.inspection.reporting.files import write_report

_FAILED = 2


@dataclass(frozen=True)
class _Task:
    """One input, and the folder for its report."""

    request: Request
    folder: Path
    origin: dict[str, Any]


@dataclass(frozen=True)
class _Outcome:
    """What a process tells of a task: its words, and whether it failed."""

    text: str
    seconds: float = 0.0
    failed: bool = False


def inspect_several(
    requests: Sequence[Request], output: Path, jobs: int | None, scheduler: str | None
) -> int:
    """Inspect all that is not done yet; 2 if any of them failed.

    Raises
    ------
    ConfigurationError
        A file of settings is not there, two inputs are one, or there is no scheduler.
    """
    settings = _settings(requests[0])
    tasks = []
    for request, folder in zip(requests, _folders(requests, output), strict=True):
        try:
            origin = made_of(request.path, settings)
        except OSError:
            origin = {}  # Not there: the inspection says so.
        tasks.append(_Task(request, folder, origin))
    done = [task for task in tasks if task.origin and is_made_of(task.folder, task.origin)]
    waiting = [task for task in tasks if task not in done]
    for task in done:
        print(f'{task.request.path}: done before, and nothing has changed since: {task.folder}')
    counts: Counter[bool] = Counter()
    with tqdm(
        desc='inspecting', total=len(waiting), unit='input', dynamic_ncols=True, disable=None
    ) as bar:
        for task, outcome in _results(waiting, jobs, scheduler):
            if isinstance(outcome, Exception):
                outcome = _Outcome(f'not inspected ({outcome}): try it alone', failed=True)
            counts[outcome.failed] += 1
            line = outcome.text
            if not line.startswith(str(task.request.path)):
                line = f'{task.request.path}: {line}'
            if not outcome.failed:
                line += f' in {outcome.seconds:.1f} s: {task.folder}'
            bar.write(line, file=sys.stderr if outcome.failed else sys.stdout)
            bar.update()
    print(f'{counts[False]} inspected, {len(done)} done before, {counts[True]} failed')
    return _FAILED if counts[True] else 0


def _results(
    tasks: Sequence[_Task], jobs: int | None, scheduler: str | None
) -> Iterator[tuple[_Task, _Outcome | Exception]]:
    if not tasks:
        return iter(())
    if scheduler:
        # Only this needs Dask.
        from ftp_dent_ros.fleet import on_cluster

        return on_cluster(_work, tasks, scheduler)
    from ftp_dent_ros.fleet import side_by_side

    return side_by_side(_work, tasks, jobs or len(os.sched_getaffinity(0)))


def _work(task: _Task) -> _Outcome:
    """Inspect one input and write its report, in whatever process this is."""
    started = time.perf_counter()
    try:
        begin(task.folder)
        report = report_of(task.request)
        write_report(task.folder, report)
        finish(task.folder, task.origin)
    except FtpDentError as error:
        return _Outcome(str(error), failed=True)
    except Exception as error:
        # One input must not cost all the others.
        said = f'{type(error).__name__}: {error}'
        return _Outcome(f'a defect of the software ({said}): report it', failed=True)
    skipped = len(report.refused) + len(report.skipped)
    text = f'{len(report.dents)} dents, {len(report.others)} others'
    text += f', {len(report.frames)} clouds' if len(report.frames) > 1 else ''
    text += f', {skipped} left out' if skipped else ''
    return _Outcome(text, time.perf_counter() - started)


def _settings(request: Request) -> dict[str, Any]:
    """What decides beside the input: files of settings by what is in them."""
    files = {name: getattr(request, name) for name in ('rig', 'pattern', 'rules')}
    return {
        **{name: content_id(find(file)) if file else None for name, file in files.items()},
        **asdict(request.settings),
        'stride': request.stride,
        'joined': request.joined,
    }


def _folders(requests: Sequence[Request], output: Path) -> list[Path]:
    """A folder for each input, by as much of its path as tells it from the others."""
    paths = [Path(os.path.abspath(request.path)) for request in requests]
    for path, times in Counter(paths).items():
        if times > 1:
            raise ConfigurationError(f'{path} is given {times} times: give each input once')
    above = Path(os.path.commonpath([path.parent for path in paths]))
    names = [path.relative_to(above) for path in paths]
    short = [name.with_suffix('') for name in names]
    return [output / name for name in (short if len(set(short)) == len(short) else names)]
