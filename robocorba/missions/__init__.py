"""Cooperative missions: mission layer, transport layer and execution layer."""
