"""The path planning agent: from a building and a request to a path.

It imports map_editor, errors and system. Read first: request (what is asked and answered), planner (in three steps),
snapshot (a building compiled for queries), search (along the roadmap), geometric (through free space)."""
