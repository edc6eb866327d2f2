"""The servers, one process each: `python -m servers.NAME --help` tells what each needs."""
