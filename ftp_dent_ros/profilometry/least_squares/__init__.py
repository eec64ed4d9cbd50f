"""Windowed least squares about the analytic reference phase: the default method."""

from ftp_dent_ros.profilometry.least_squares.method import LeastSquares
from ftp_dent_ros.profilometry.least_squares.quality import Quality

__all__ = ['LeastSquares', 'Quality']
