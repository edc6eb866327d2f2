"""The operator's console: the paper's windows as pages of a web browser. A CORBA client like any other.

It may import every room but commands. Read first: server (the pages' server), viewers (what flows to each page),
operations (what pages can ask for), live_floors (the floors as they are now), history (as they were)."""
