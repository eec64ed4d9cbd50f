"""How the drone flies, and how its autopilot's estimate errs."""
