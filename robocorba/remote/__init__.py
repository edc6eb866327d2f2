"""What domain code calls, as CORBA objects: its ports, made of references."""
