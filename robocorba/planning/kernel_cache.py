"""Where compiled kernels are kept between runs.

numba looks only at a function's own file to see whether what it kept is stale, and fails
on kept types that are no more. So each state of this package's sources has a folder of
its own: kernels never mix, neither after an edit nor after an upgrade.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from pathlib import Path

import numba
import platformdirs

#: Folders of older states that are kept, so that two checkouts don't compile in turn.
MOST_KEPT = 4


def use() -> None:
    """Let numba keep this package's kernels in the folder of its sources' state; NUMBA_CACHE_DIR wins."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    name = digest.hexdigest()[:16]
    for root in (platformdirs.user_cache_path("robocorba"), Path(tempfile.gettempdir()) / f"robocorba-{os.getuid()}"):
        folder = root / "kernels" / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError:
            continue
        numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
        _forget_old(folder.parent)
        return


def _forget_old(kernels: Path) -> None:
    states = sorted(kernels.iterdir(), key=lambda state: state.stat().st_mtime, reverse=True)
    for state in states[MOST_KEPT:]:
        shutil.rmtree(state, ignore_errors=True)
