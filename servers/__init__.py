"""The servers, one process each: `python -m robocorba.servers.NAME --help` tells what each needs."""
