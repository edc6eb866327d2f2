"""What produces the figures: `python -m bench` runs all, `python -m bench.NAME` one."""

from pathlib import Path

#: Folder of the benches' results.
RESULTS = Path(__file__).parent / "results"
