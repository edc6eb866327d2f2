"""The command `robocorba`, as `python -m robocorba`."""

import sys

if not (sys.flags.isolated or getattr(sys.flags, "safe_path", False)):
    del sys.path[0]  # the current directory: files there must not replace modules

from robocorba.commands import main

if __name__ == "__main__":
    main()
