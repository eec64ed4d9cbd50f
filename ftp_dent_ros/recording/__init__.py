"""Bags: record, replay, recover, by the libraries `mcap` and `rosbags`."""

from ftp_dent_ros.recording.reader import Bag, open_bag
from ftp_dent_ros.recording.topic import Message, RecordedTopic

__all__ = ['Bag', 'Message', 'RecordedTopic', 'open_bag']
