"""Names shared by servers and clients."""

#: Naming contexts below RoboCorba; each holds the objects of one kind.
CHANNELS = "EventChannels"
SENSORS = "VirtualSensors"
ROBOTS = "Robots"
ADAPTORS = "Adaptors"
#: Key of the agent at the address of a robot's own computer.
ROBOT_AGENT = "RobotAgent"
#: Subfolder of the state folder with the reports of missions that a robot led.
MISSIONS = "missions"
#: File in the state folder with the object reference of the simulation's administrator.
ADMINISTRATOR = "administrator.ior"
#: File in the state folder with the object reference of the supervisor of `robocorba up`.
SUPERVISOR = "supervisor.ior"
#: File in the state folder with the ports of the servers of `robocorba up`, and of the naming service, `naming`.
PORTS = "ports.json"
#: File in the state folder with the token by which virtual sensor servers register.
SENSOR_TOKEN = "sensors.token"
#: File in the state folder with the robots' stop targets, and which robots are held by an emergency stop.
STOPS = "stops.json"
#: Type of the event that stops robots: {"robots": [names], "reason": text}; without names all.
STOP_EVENT = "robot.stop"
#: Type of the event with what a robot sees that its map lacks.
SIGHTING_EVENT = "obstacle.seen"
#: Subfolder of the state folder with the files of the roles of a guarded system.
ACCESS = "access"
#: The process of the operator's console.
CONSOLE = "console"
