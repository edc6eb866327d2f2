"""How fast and how small: starts of the system and of its servers, beside those of an earlier commit."""
