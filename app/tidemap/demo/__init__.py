"""A simulated building and the robot that lives in it: the demo, posted through the public client."""
