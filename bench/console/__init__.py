"""Benches of the operator's console."""
