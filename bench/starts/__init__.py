"""How fast and how small: starts of the system, servers that come back, memory."""
