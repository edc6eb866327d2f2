"""Names shared by servers and clients."""

#: Naming contexts below RoboCorba; each holds the objects of one kind.
CHANNELS = "EventChannels"
SENSORS = "VirtualSensors"
ROBOTS = "Robots"
ADAPTORS = "Adaptors"
#: Subfolder of the state folder with the reports of missions that a robot led.
MISSIONS = "missions"
#: File in the state folder with the object reference of the simulation's administrator.
ADMINISTRATOR = "administrator.ior"
#: File in the state folder with the object reference of the supervisor of `robocorba up`.
SUPERVISOR = "supervisor.ior"
#: Subfolder of the state folder with the files of the roles of a guarded system.
ACCESS = "access"
