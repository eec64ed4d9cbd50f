"""The page on the ground: what the drone sees, without ROS and without the internet."""
