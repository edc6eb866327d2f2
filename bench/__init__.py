"""What produces the figures: `python -m bench` runs all, `python -m bench.NAME` one."""
