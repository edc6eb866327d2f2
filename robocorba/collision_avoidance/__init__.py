"""How robots keep out of each other's way: who is near, who gives way, where to step aside, what stands on the path."""
