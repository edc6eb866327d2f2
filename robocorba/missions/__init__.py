"""Missions: what robots do together. Mission layer, transport layer and execution layer."""
