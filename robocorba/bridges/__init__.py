"""Bridges to other systems: ROS 2, Foxglove, OpenRTM. Extras, which only commands import.

They import rooms as the console does. Read first: ros2.publisher and ros2.robot_interface (topics and orders),
foxglove.publisher, openrtm.robot_component, and `console.corba.live_system`, which they follow."""
