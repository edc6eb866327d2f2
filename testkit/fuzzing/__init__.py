"""Arguments for every operation of the IDL, made from the type descriptors in the stubs, and a system to call.

values.py         arguments that an ORB can send: plausible, extreme, and plausible with one extreme part
wire.py           what no ORB sends: ill-formed UTF-8, enumerators that don't exist, messages that end too early
operations.py     the interfaces and operations of the IDL
calls.py          calls of one operation, and what came of them
fuzzed_system.py  a running system to call
examples.py       examples of what clients send
targets.py        all objects of the system, with examples of arguments; those of the map editor server, of the
                  simulation, of event channels and of robots are in files of their own
"""

import omniORB  # noqa: F401  without it, CosEventComm and CosEventChannelAdmin can't be imported
