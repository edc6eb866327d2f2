"""A minimal robot, with only an ORB and the IDL: it drives until an obstacle is near.

python -m robocorba.clients.new_robot [URI of SimulationServer]"""

import sys
import time

from omniORB import CORBA

from robocorba.stubs import RoboCorba

uri = sys.argv[1] if len(sys.argv) > 1 else "corbaname::127.0.0.1:2809#RoboCorba/SimulationServer"
orb = CORBA.ORB_init([], CORBA.ORB_ID)
server = orb.string_to_object(uri)._narrow(RoboCorba.SimulationServer)
start, limits = RoboCorba.Pose("L1", 3, 4, 0), RoboCorba.MotionLimits(1.0, 1.75, 1.0, 1.75)
robot = server.registerRobot(RoboCorba.RobotDescription("new", start, 0.4, 127, limits))
try:
    sensor, waist = robot.sensor, RoboCorba.Mount(0, 0, 0)
    while min(sensor.scan(robot.state().at, waist, sensor.laser()).distances[60:120]) > 1.0:  # ahead
        robot.command(RoboCorba.Velocity(0.5, 0, 0), 0.5)  # valid for half a second unless repeated
        time.sleep(0.1)
    print("something is near", robot.state().at)
finally:
    robot.deregister()
