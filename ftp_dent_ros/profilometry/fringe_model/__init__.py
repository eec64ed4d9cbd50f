"""One model of the fringes and one solver: a photograph to a cloud.

The light of a bin is ``I = level + amplitude F(Phi) + noise`` (eq. 1): level and amplitude hold
paint, ambient light and what of the projector's light arrives; F is one waveform with global
unknowns; Phi is the projector's phase, which the depth shifts.
"""

from ftp_dent_ros.profilometry.fringe_model.method import FringeModel

__all__ = ['FringeModel']
