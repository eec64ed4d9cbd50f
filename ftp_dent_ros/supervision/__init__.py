"""What starts and watches the nodes: configurations, processes, transport; without rclpy."""
