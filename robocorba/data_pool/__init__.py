"""The data pool: what a robot knows of the floor that it is on, and the plans that it keeps for others."""
