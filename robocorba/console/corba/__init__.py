"""The running system as windows, films and bridges follow it."""
