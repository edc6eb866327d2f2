"""Values about places that many parts share: points, poses, frames, grids, and a floor with what moves on it."""
