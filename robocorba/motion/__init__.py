"""How a robot moves: what it has to do at each tick, along lines with its base, between postures with its joints."""
