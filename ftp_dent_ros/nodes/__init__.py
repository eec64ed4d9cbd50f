"""The rclpy nodes: parameters, subscriptions, one call, publications.

However they are started, each computes with one thread of BLAS, for they share the computer, and
keeps the memory that message after message needs.
"""

from ftp_dent_ros.process import keep_freed, one_for_blas

one_for_blas()
keep_freed()
