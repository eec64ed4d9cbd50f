"""From the kernel's time of a V4L2 buffer to the middle of the exposure in ROS time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

# A buffer older than this was not just filled; one from the future, beyond what a driver's
# clock recovery may err by, is another clock's (or the position in a video file).
_OLDEST_NS = 1_000_000_000
_NEWEST_NS = -5_000_000


@dataclass(frozen=True)
class ExposureClock:
    """Turns the time of a buffer into the middle of its exposure.

    Attributes
    ----------
    exposure : float
        Seconds; 0 if unknown.
    at_start : bool
        Whether the driver stamps the start of the exposure (``V4L2_BUF_FLAG_TSTAMP_SRC_SOE``),
        not the end of the frame, which is V4L2's default.
    offset : float
        Seconds added to every stamp, for what is known of this camera's delay.
    """

    exposure: float = 0.0
    at_start: bool = False
    offset: float = 0.0

    def stamp_ns(self, buffer_ms: float, monotonic_ns: int, ros_ns: int) -> tuple[int, bool]:
        """Middle of the exposure, and whether it comes from the kernel.

        Parameters
        ----------
        buffer_ms : float
            Time of the buffer on the monotonic clock, milliseconds (``CAP_PROP_POS_MSEC``).
        monotonic_ns, ros_ns : int
            Monotonic time and ROS time of one moment just after the buffer arrived.

        Returns
        -------
        int
            Nanoseconds of ROS time. Where the buffer's time is implausible, the time of arrival
            less half the exposure: readout and transfer are then in the stamp.
        bool
        """
        age = monotonic_ns - round(buffer_ms * 1e6)
        from_kernel = buffer_ms > 0 and _NEWEST_NS <= age <= _OLDEST_NS
        half = self.exposure / 2
        to_middle = half if from_kernel and self.at_start else -half
        taken = ros_ns - (age if from_kernel else 0)
        return taken + round((to_middle + self.offset) * 1e9), from_kernel


def stamps_exposure_start(device: str) -> bool:
    """Whether the driver of a device file stamps the start of the exposure, as uvcvideo does."""
    name = Path(device).resolve().name
    driver = Path('/sys/class/video4linux') / name / 'device' / 'driver'
    return driver.resolve().name == 'uvcvideo'
