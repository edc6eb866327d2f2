"""What starts, names, watches and ends the processes of a RoboCorba system.

A supervisor of our own, because supervisord looks once a second and gives up on a server that keeps
dying, circus is hardly kept, and neither waits for a real call nor dies together with its children.

    system.py    the whole: naming service first, then the servers, until told to stop
    process.py   one process: start it, wait until it answers, start it again when it ends
    child.py     runs in a new process before the real program does, so that nothing outlives us
    folder.py    the state folder: its lock, the ports of the servers, what runs now
    servers.py   which servers there are
    subnets.py   which event channels there are, and which of them are linked
"""
