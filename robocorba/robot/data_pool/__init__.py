"""The data pool: a robot's copy of the state of its floor, and the cooperative plans that it stores for others."""
