"""How a node with several threads ends."""

from __future__ import annotations

import gc
import threading

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup

from ftp_dent_ros.ros.node import ThreadedExecutor


def end_at_work(domain):
    """What a shutdown gives, and what callbacks had ended by then."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node('ending', context=context)
    executor = ThreadedExecutor(4, context=context)
    begun, may_end, ended = threading.Event(), threading.Event(), []

    def wait():
        begun.set()
        ended.append(may_end.wait(30))

    for _ in range(4):
        node.create_timer(0.001, wait, callback_group=ReentrantCallbackGroup())
    executor.add_node(node)
    while not begun.is_set():
        executor.spin_once(timeout_sec=0.1)
    told: list = []

    def end():
        told.append(executor.shutdown(30))
        told.extend(ended)

    ending = threading.Thread(target=end)
    ending.start()
    assert told == []
    may_end.set()
    ending.join()
    node.destroy_node()
    context.try_shutdown()
    return told


def test_callbacks_under_way_end_before_what_they_use_is_destroyed(domain, capfd):
    shut, *ended = end_at_work(domain)
    assert shut and ended and all(ended)
    gc.collect()
    assert 'never retrieved' not in capfd.readouterr().err
