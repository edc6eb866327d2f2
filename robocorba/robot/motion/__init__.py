"""Motions: the command of each control cycle, for driving along lines and for moving joints between postures."""
