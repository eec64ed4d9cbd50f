"""Messages to arrays: those of rclpy and those that a bag gives, without rclpy."""
