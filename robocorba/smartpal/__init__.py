"""The actual robot's stand-in: MuJoCo's dynamics of SmartPal, and the state machines of its units.

Units speak as their public interface does: millimetres and degrees. Dynamics is SI. Nothing here belongs to the
simulation server, which has physics of its own."""
