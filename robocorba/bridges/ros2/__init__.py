"""Robots, maps and recordings for ROS 2."""
