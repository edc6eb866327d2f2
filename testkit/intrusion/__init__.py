"""Attacks on a guarded system by somebody who has a role in it.

intruder.py        calls everything that there is to call, and notes what is not as robocorba/system/roles.py has it
guarded_system.py  the system, its secrets and its state; what a robot may try to forge
"""
