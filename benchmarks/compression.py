"""Size and time of a bag's clouds and pictures as `ftp-dent record --compress` stores them.

python benchmarks/compression.py BAG        # of `ftp-dent demo`, say: out/demo/bag
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

from ftp_dent_ros.coding.cloud_codec import RayGrid, decode, encode
from ftp_dent_ros.coding.messages import cloud_from_message, lens_from_message
from ftp_dent_ros.recording.compression import CompressedBagWriter
from ftp_dent_ros.recording.reader import open_bag


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('bag', type=Path)
    arguments = parser.parse_args()
    bag = open_bag(arguments.bag)
    sizes: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    with tempfile.TemporaryDirectory() as folder:
        with CompressedBagWriter(Path(folder) / 'bag') as writer:
            for topic in bag.metadata.topics:
                writer.add_topic(topic)
            for message in bag.messages():
                before = writer.size
                writer.write([message])
                sizes[message.topic][0] += len(message.data)
                sizes[message.topic][1] += writer.size - before
        whole = sum(path.stat().st_size for path in bag.files)
        small = sum(path.stat().st_size for path in Path(folder, 'bag').glob('*.mcap'))
        print(f'bag: {whole / 1e6:.1f} MB, compressed {small / 1e6:.1f} MB')
    for name, (before, after) in sorted(sizes.items(), key=lambda item: -item[1][0])[:6]:
        print(f'  {name:22} {before / 1e6:7.1f} MB {after / 1e6:6.1f} MB')
    clouds(bag)


def clouds(bag) -> None:
    """Errors, sizes and times of the clouds in the camera's frame."""
    info = bag.deserialise(next(bag.messages(['/camera/camera_info'])))
    lens = lens_from_message(info)
    size, coding, decoding, worst, part = [], [], [], 0.0, 0.0
    for message in bag.messages(['/points']):
        cloud = cloud_from_message(bag.deserialise(message))
        view = RayGrid.of(lens, *cloud.intensity.shape)
        times = [time.thread_time()]
        data = encode(cloud, view)
        times.append(time.thread_time())
        back = decode(data)
        times.append(time.thread_time())
        off = np.linalg.norm(back.points.astype(float) - cloud.points, axis=2)
        worst = max(worst, float(np.nanmax(off)))
        if np.isfinite(cloud.sigma).any():
            part = max(part, float(np.nanmax(off / cloud.sigma)))
        size.append(len(data))
        coding.append(times[1] - times[0])
        decoding.append(times[2] - times[1])
    print(
        f'clouds: {len(size)}, {np.median(size) / 1e3:.0f} kB median, {max(size) / 1e3:.0f} most'
    )
    print(f"  error {1e6 * worst:.2f} um at most, {part:.2f} of a point's own uncertainty at most")
    print(
        f'  {1e3 * np.median(coding):.1f} ms to code, '
        f'{1e3 * np.median(decoding):.1f} ms to decode (median, processor time)'
    )


if __name__ == '__main__':
    main()
