"""The simulated building: floors with robots and objects under physics, elevators, simulated time. No CORBA here."""
