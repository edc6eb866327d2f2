"""The simulation server: registered robots and their sessions, the Omni database, floors under physics, elevators,
reserved areas, simulated time, the 2D simulator's pictures and recordings.

It imports map_editor, planning, errors and system. Read first: management_agent (robots come and go), building (what
moves), simulation_loop (one thread, 50 steps a second), omni_database (the floors' states in versions), session (what a
robot orders). `sensing` has the virtual sensors."""
