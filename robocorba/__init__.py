"""RoboCorba: a CORBA-based cooperative mobile robot system."""

__version__ = "0.1.0"
