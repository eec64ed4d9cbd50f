"""The rclpy nodes: parameters, subscriptions, one call, publications."""
