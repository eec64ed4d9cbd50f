"""Many bags inspected side by side: how much faster, and whether to the same results.

python benchmarks/fleet.py [--bags 20] [--clouds 41] [--folder DIR] [--dask]

One simulated flight is photographed and recorded, if the folder does not hold it already, and
linked under as many names. Printed are the time of one bag with its report (processor time of a
process of its own, start and all), that of all of them by one process and by two, and with --dask
by two workers of a Dask cluster. On a machine that does something else, processor time grows too
and the ratio of one process to two falls: run it on one that does not.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
COMMAND = (sys.executable, '-m', 'ftp_dent_ros.cli.main', 'inspect', '--rig', 'shipped:rig.yaml')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--bags', type=int, default=20)
    parser.add_argument('--clouds', type=int, default=41)
    parser.add_argument('--folder', type=Path, default=Path('out/fleet'))
    parser.add_argument('--dask', action='store_true', help='by a Dask cluster, too')
    arguments = parser.parse_args()
    folder = arguments.folder
    flight = folder / f'flight{arguments.clouds}'
    if not flight.exists():
        made = [sys.executable, str(HERE / 'flight_bags.py'), str(flight)]
        subprocess.run([*made, '--clouds', str(arguments.clouds)], check=True)
    bags = [folder / 'bags' / f'{number:02}' for number in range(arguments.bags)]
    for bag in bags:
        bag.mkdir(parents=True, exist_ok=True)
        for path in flight.iterdir():
            if not (bag / path.name).exists():
                os.link(path, bag / path.name)
    seconds, processor = inspected([flight], folder / 'alone')
    print(f'one bag of {arguments.clouds} clouds {seconds:.1f} s, processor {processor:.1f} s')
    ways = {'one process': ('--jobs', '1'), 'two processes': ('--jobs', '2')}
    taken = {}
    for name, words in ways.items():
        taken[name] = inspected(bags, folder / name.replace(' ', '_'), *words)
    if arguments.dask:
        from distributed import LocalCluster

        cluster = LocalCluster(2, threads_per_worker=1, host='127.0.0.1', dashboard_address=None)
        with cluster:
            words = ('--scheduler', cluster.scheduler_address)
            taken['two Dask workers'] = inspected(bags, folder / 'two_Dask_workers', *words)
    for name, (seconds, processor) in taken.items():
        print(f'{len(bags)} bags, {name:16} {seconds:6.1f} s, processor {processor:6.1f} s')
    one, two = taken['one process'][0], taken['two processes'][0]
    print(f'two processes are {one / two:.2f} times as fast as one')
    results = [
        {result(folder / name.replace(' ', '_') / bag.name) for bag in bags} for name in taken
    ]
    results.append({result(folder / 'alone')})
    same = all(each == results[0] and len(each) == 1 for each in results)
    print('results: the same bit for bit' if same else 'RESULTS DIFFER')


def inspected(bags: list[Path], output: Path, *words: str) -> tuple[float, float]:
    """Seconds, and seconds of processor time, that the command takes afresh."""
    shutil.rmtree(output, ignore_errors=True)
    before, started = _spent(), time.perf_counter()
    command = [*COMMAND, *map(str, bags), '--output', str(output), *words]
    environment = {**os.environ, 'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
    return time.perf_counter() - started, _spent() - before


def result(folder: Path) -> bytes:
    """dents.json but for the bag's name and the time of writing, and dents.csv."""
    record = json.loads((folder / 'dents.json').read_text())
    del record['source'], record['written']
    return json.dumps(record).encode() + (folder / 'dents.csv').read_bytes()


def _spent() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == '__main__':
    main()
