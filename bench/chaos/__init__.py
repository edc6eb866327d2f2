"""Attacks on a running system beside clients that do nothing wrong."""
