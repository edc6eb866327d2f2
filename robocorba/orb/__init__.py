"""The ORB of a process: its life, names, timeouts, guards, conversion of values.

It imports errors and system; with each room's `corba` it is all that knows omniORB. Read first: orb (an ORB and its
names), naming (resolved and kept bound), calls (timeouts and errors), exceptions (domain errors as IDL exceptions),
structs (values as IDL structs)."""

import omniORB  # noqa: F401  Python finds CosNaming only then.
