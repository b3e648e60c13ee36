"""A real rclpy in an environment of its own, and what drives the node of docs/examples/ros2 there."""
