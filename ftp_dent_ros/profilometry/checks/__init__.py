"""Whether one photograph can be of the given pattern and rig: its frame, and its rows."""
