"""Whether a rig still holds, from photographs under its flight pattern."""
