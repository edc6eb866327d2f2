"""Naming contexts below RoboCorba in which objects of one kind are bound by their names."""

CHANNELS = "EventChannels"
SENSORS = "VirtualSensors"
