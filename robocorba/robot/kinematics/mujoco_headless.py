"""MuJoCo without OpenGL, by which no process of ours draws.

MuJoCo looks for it when it is imported, with an interpreter of its own: 0.15 s of a core in each process. If MUJOCO_GL
is in the environment, it does as that says."""

from __future__ import annotations

import os

_is_set = "MUJOCO_GL" in os.environ
os.environ.setdefault("MUJOCO_GL", "disable")
import mujoco  # noqa: E402

if not _is_set:
    del os.environ["MUJOCO_GL"]  # it holds for this process only

__all__ = ["mujoco"]
