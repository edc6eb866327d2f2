"""A robot's kinematics: its joints, the poses of its links, and how its hands reach a pose."""
