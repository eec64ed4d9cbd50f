"""Windowed least squares about the analytic reference phase: the default method."""

from ftp_dent_ros.profilometry.least_squares.method import LeastSquares

__all__ = ['LeastSquares']
