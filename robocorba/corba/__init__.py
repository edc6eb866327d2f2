"""Everything that needs the ORB: its life, names, servants, clients of other processes, conversion of values."""
