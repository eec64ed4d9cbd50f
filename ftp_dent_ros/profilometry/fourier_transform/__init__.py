"""Fourier transform profilometry: the paper's methods, direct and with a virtual reference."""

from ftp_dent_ros.profilometry.fourier_transform.method import FourierTransform

__all__ = ['FourierTransform']
