"""Robots as RT components, for tools and components of OpenRTM."""
