"""Cooperation in three layers: a leader divides a mission into SubPlans, event channels carry them, robots execute them
in step and report back.

It imports robot, simulation, planning, map_editor, errors and system. Read first: leader (the mission layer), transport
(the transport layer), execution (the execution layer), subplan (what is carried), succession (who leads when the leader
is gone)."""
