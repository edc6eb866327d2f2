"""Names that servers and their clients agree on."""

#: Naming contexts below RoboCorba in which objects of one kind are bound by their names.
CHANNELS = "EventChannels"
SENSORS = "VirtualSensors"
ROBOTS = "Robots"
ADAPTORS = "Adaptors"
#: The folder in the state folder with what is known of missions that a robot led.
MISSIONS = "missions"
#: The file in the state folder with the reference of the simulation's administrator.
ADMINISTRATOR = "administrator.ior"
