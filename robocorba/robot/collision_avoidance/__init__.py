"""Collision avoidance: nearby robots, giving way, stepping aside, and temporary obstacles of paths."""
