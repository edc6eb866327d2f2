"""A robot that speaks ROS 2 and knows nothing of RoboCorba: a disc with a laser 0.1 m ahead, before a wall.

    python -m testkit.ros2_robot X

Its odometry begins at the origin, ahead along x; at X [m] a wall stands across x. The robot stops 0.5 s after its last
velocity, and prints where it is ten times a second. It runs in a Python with ROS 2, see ros2_environment."""

from __future__ import annotations

import math
import sys
import time
from typing import Any

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

PERIOD_S, VALID_S, RAYS, LASER_AHEAD_M = 0.02, 0.5, 181, 0.1


def main(obstacle_x: float) -> None:
    rclpy.init()
    node = rclpy.create_node("disc")
    x = y = heading = 0.0
    velocity, arrived_at, ticks = (0.0, 0.0, 0.0), 0.0, 0
    odometry = node.create_publisher(Odometry, "odom", 10)
    scans = node.create_publisher(LaserScan, "scan", qos_profile_sensor_data)

    def obey(wanted: Twist) -> None:
        nonlocal velocity, arrived_at
        velocity, arrived_at = (wanted.linear.x, wanted.linear.y, wanted.angular.z), time.monotonic()

    def distance(angle: float) -> float:
        c = math.cos(heading + angle)
        return (obstacle_x - x - LASER_AHEAD_M * math.cos(heading)) / c if c > 1e-6 else math.inf

    def tick() -> None:
        nonlocal x, y, heading, ticks
        ahead, left, turn = velocity if time.monotonic() < arrived_at + VALID_S else (0.0, 0.0, 0.0)
        c, s = math.cos(heading), math.sin(heading)
        x, y = x + (c * ahead - s * left) * PERIOD_S, y + (s * ahead + c * left) * PERIOD_S
        heading += turn * PERIOD_S
        state: Any = Odometry()
        state.header.stamp = node.get_clock().now().to_msg()
        state.pose.pose.position.x, state.pose.pose.position.y = x, y
        state.pose.pose.orientation.z, state.pose.pose.orientation.w = math.sin(heading / 2), math.cos(heading / 2)
        state.twist.twist.linear.x, state.twist.twist.linear.y, state.twist.twist.angular.z = ahead, left, turn
        odometry.publish(state)
        ticks += 1
        if ticks % 5 == 0:
            scan: Any = LaserScan(range_min=0.05, range_max=8.0, angle_min=-math.pi / 2, angle_max=math.pi / 2)
            scan.header.stamp, scan.angle_increment = state.header.stamp, math.pi / (RAYS - 1)
            scan.ranges = [distance(scan.angle_min + ray * scan.angle_increment) for ray in range(RAYS)]
            scans.publish(scan)
            print(f"{x:.4f}\t{y:.4f}\t{heading:.4f}", flush=True)

    node.create_subscription(Twist, "cmd_vel", obey, 10)
    node.create_timer(PERIOD_S, tick)
    rclpy.spin(node)


if __name__ == "__main__":
    main(float(sys.argv[1]))
