"""The stand-in for the actual robot, for tests without one: MuJoCo dynamics of SmartPal, and the state machines of its
units. The control agent reaches it through `robot/smartpal_adaptor.py`, as it does the robot.

The units use millimetres and degrees, as SmartPal's public interface does; the dynamics uses SI units. Nothing here
belongs to the simulation server, which has its own physics. "Assumed" marks constants that SmartPal's documents do not
give."""
