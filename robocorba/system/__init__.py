"""What every process needs: settings, logs, durable files, threads, compiled kernels; and how a system is started.

It imports errors; `supervision` and `corba`, which start and watch processes, import every room but console, bridges
and commands. Read first: settings (from arguments and environment), background (threads), record_file (what must last),
kernels (compiled functions), supervision.system (`robocorba up`)."""
