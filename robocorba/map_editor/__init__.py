"""The map building agent: the geometrical and the topological map of a building, edited by many clients and kept in
versions; map files of other systems.

It imports errors and system; `spatial` has the values about places that all rooms use. Read first: model (the
building), map_building_agent (edits in transactions), store (on disk), validation (its rules), checking (what robots
can't do in it). `topology` draws topological maps, `formats` reads and writes map files, `corba` is the agent's IDL."""
