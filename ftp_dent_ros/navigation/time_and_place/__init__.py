"""The autopilot's clock, places on the earth, and frames, in ROS's."""
