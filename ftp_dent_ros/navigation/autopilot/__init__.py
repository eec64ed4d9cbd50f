"""The one autopilot that is believed: what is asked of it, what is known of it."""
