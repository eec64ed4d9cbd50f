"""A calibration as a page that people read."""
