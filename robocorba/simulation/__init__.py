"""The simulated building: floors with robots and objects that move by physics, elevators, time. No CORBA here."""
