"""The command `robocorba`, as `python -m robocorba`."""

from robocorba.commands import main

if __name__ == "__main__":
    main()
