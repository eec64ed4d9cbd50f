"""One end of the link as a program, for the two ends of a simulated radio.

drone ADDRESS COUNT   gives so many clouds and a list, and says what is left until its input ends
ground ADDRESS COUNT  prints each item that comes, until so many clouds have
"""

import random
import sys
import threading
import time

from ftp_dent_ros.ground.commands import Executive
from ftp_dent_ros.ground.drone import Drone
from ftp_dent_ros.ground.link import GroundLink, Security
from ftp_dent_ros.ground.protocol import Importance, Item
from ftp_dent_ros.ground.station import Station


def drone(address, count):
    end = Drone(GroundLink('drone', address, Security(open=True)), None, 10**8, 0.0, Executive({}))
    for stamp in range(count):
        data = random.Random(stamp).randbytes(20_000)
        end.put(Item(Importance.CLOUDS, 'points', 'k', stamp, data))
        end.put(Item(Importance.DENTS, 'dents', 'k', stamp, bytes(200)))
    sys.stdin.read()
    end.close()


def ground(address, count):
    came, whole = [], threading.Event()

    def take(item):
        print(item.importance.name, item.stamp_ns, len(item.data), flush=True)
        came.append(item)
        if len(came) == 2 * count:
            whole.set()

    end = Station(GroundLink('ground', address, Security(open=True)), take, 'ground')
    whole.wait(60)
    time.sleep(0.5)  # for what should not come twice
    end.close()


if __name__ == '__main__':
    {'drone': drone, 'ground': ground}[sys.argv[1]](sys.argv[2], int(sys.argv[3]))
