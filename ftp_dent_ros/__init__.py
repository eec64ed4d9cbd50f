"""Single-shot fringe-projection dent inspection of aircraft skin from a drone."""

__version__ = '0.1.0'
