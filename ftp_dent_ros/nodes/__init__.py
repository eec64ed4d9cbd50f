"""The rclpy nodes: parameters, subscriptions, one call, publications.

However they are started, each computes with one thread of BLAS: they share the computer.
"""

from ftp_dent_ros.threads import one_for_blas

one_for_blas()
