"""The servers, one process each: `python -m robocorba.servers.NAME --help` lists its arguments."""
