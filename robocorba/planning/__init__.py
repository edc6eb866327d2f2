"""Domain code of the path planning agent: from a building and a request to a path. It imports no CORBA."""
