"""A robot that wanders about until Ctrl-C: python -m clients.wander [NAME [FLOOR X Y [URI of SimulationServer]]]"""

import sys
import time

from omniORB import CORBA

from robocorba.stubs import RoboCorba


def main(name="wanderer", floor="L1", x="3", y="4", uri="corbaname::127.0.0.1:2809#RoboCorba/SimulationServer"):
    orb = CORBA.ORB_init([], CORBA.ORB_ID)
    server = orb.string_to_object(uri)._narrow(RoboCorba.SimulationServer)
    limits = RoboCorba.MotionLimits(1.0, 1.75, 1.0, 1.75)
    start = RoboCorba.Pose(floor, float(x), float(y), 0.0)
    robot = server.registerRobot(RoboCorba.RobotDescription(name, start, 0.4, 127.0, limits))
    sensor = robot.sensor
    laser, waist = sensor.laser(), RoboCorba.Mount(0.0, 0.0, 0.0)
    try:
        while True:
            ahead = sensor.scan(robot.state().at, waist, laser).distances[50:130]
            way = RoboCorba.Velocity(0.5, 0.0, 0.0) if min(ahead) > 0.8 else RoboCorba.Velocity(0.0, 0.0, 0.8)
            robot.command(way, 0.5)
            time.sleep(0.1)
    finally:
        robot.deregister()


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except KeyboardInterrupt:
        sys.exit()
    except CORBA.Exception as refused:
        sys.exit(f"wander: {refused}")
