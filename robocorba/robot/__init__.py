"""The robot client: its control agent runs the same program on a virtual or an actual robot through one adaptor.

It imports simulation, planning, map_editor, errors and system. Read first: agent (tasks and stops), runner (a program
icon by icon), robot (one method for each movement), high_controller (the 50 Hz loop), adaptor (what a robot has to
offer).

`programs` is the graphic programming agent, `data_pool` what the robot knows, `kinematics` its body, `motion` its ways
to move, `collision_avoidance` how it gives way, `smartpal_stand_in` the stand-in for an actual robot."""
