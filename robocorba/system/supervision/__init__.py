"""Starts, supervises and ends the processes of a RoboCorba system.

Existing supervisors do not fit: supervisord polls once a second and abandons a server that keeps failing, circus is
hardly maintained, and neither probes a server by a call or ends together with its children.

    system.py     the whole system: first the naming service, then the servers, until a signal to stop
    supervisor.py what other processes may ask it: states of processes, logs, robots to start and end
    process.py    one supervised process: start it, wait until it answers, restart it when it ends
    starter.py    starts processes: forks of warm_parent.py, and commands by launch.py and child.py
    output.py     what processes print
    robots.py     robots that are started and ended on order
    fleet.py      many robots that are started, shown and ended together; fleet_file.py: their file
    access.py     the rights to a guarded system; backups.py: copies of its state folder
"""
