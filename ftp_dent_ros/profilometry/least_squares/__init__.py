"""Windowed least squares about the analytic reference phase."""
