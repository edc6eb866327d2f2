"""Starts, supervises and ends the processes of a RoboCorba system.

Existing supervisors do not fit: supervisord polls once a second and abandons a server that keeps failing, circus is
hardly maintained, and neither probes a server by a call or ends together with its children.

    system.py     the whole system: first the naming service, then the servers, until a signal to stop
    supervisor.py what other processes may ask it: states of processes, logs, robots to start and end
    process.py    one supervised process: start it, wait until it answers, restart it when it ends
    launch.py     command lines and child processes
    child.py      binds a new process to the life of its parent, then runs the program
    folder.py     the state folder: its lock, the ports of the servers, the processes that run
    output.py     what processes print
    servers.py    the servers of a system
    robots.py     robots that are started and ended on order
    fleet.py      many robots that are started, shown and ended together
    fleet_file.py their file
    console.py    the operator's console as a process
    subnets.py    the event channels of a system, and the links between them
"""
