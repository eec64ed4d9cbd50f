"""Messages to the package's arrays, without rclpy, and clouds and depths in few bytes."""
