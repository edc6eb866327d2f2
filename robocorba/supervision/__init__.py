"""Starts, supervises and ends the processes of a RoboCorba system.

Existing supervisors do not fit: supervisord polls once a second and abandons a server that keeps failing, circus is
hardly maintained, and neither probes a server by a call or ends together with its children.

    system.py    the whole system: first the naming service, then the servers, until a signal to stop
    process.py   one supervised process: start it, wait until it answers, restart it when it ends
    launch.py    command lines and child processes
    child.py     binds a new process to the life of its parent, then runs the program
    folder.py    the state folder: its lock, the ports of the servers, the processes that run
    servers.py   the servers of a system
    subnets.py   the event channels of a system, and the links between them
"""
