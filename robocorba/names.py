"""Names shared by servers and clients."""

#: Naming contexts below RoboCorba; each holds the objects of one kind.
CHANNELS = "EventChannels"
SENSORS = "VirtualSensors"
ROBOTS = "Robots"
ADAPTORS = "Adaptors"
#: Folder in the state folder with the records of missions that a robot led.
MISSIONS = "missions"
#: File in the state folder with the object reference of the simulation's administrator.
ADMINISTRATOR = "administrator.ior"
