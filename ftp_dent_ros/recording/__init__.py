"""Bags: record, replay, recover.

The libraries `mcap` and `rosbags` do what they can; each module says which promise needs it
beside them.
"""

from ftp_dent_ros.recording.reader import Bag, open_bag, read_messages
from ftp_dent_ros.recording.topic import Message, Topic

__all__ = ['Bag', 'Message', 'Topic', 'open_bag', 'read_messages']
