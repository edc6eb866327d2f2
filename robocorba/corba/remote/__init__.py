"""Clients of objects in other processes, as domain code calls them."""
