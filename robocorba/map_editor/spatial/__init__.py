"""Geometric values that several packages share: points, poses, frames, grids, and floors with their moving bodies."""
