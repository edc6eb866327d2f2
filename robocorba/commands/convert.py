"""robocorba convert: writes a recording with the messages of other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import only_for
from robocorba.commands.reporting import reporting
from robocorba.system.extras import require_extra
from robocorba.system.output_files import check_output
from robocorba.system.plain_names import names_in
from robocorba.system.printing import echo


def convert(
    context: typer.Context,
    recording: Annotated[Path, typer.Argument(metavar="IN", help="Recording that `robocorba record` wrote.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="MCAP file for Foxglove, or folder of the ROS 2 bag.")],
    ros2: Annotated[bool, typer.Option("--ros2", help="Write a ROS 2 bag.")] = False,
    robots: Annotated[str, typer.Option(metavar="A,B", help="With --ros2: only these robots. Default: all.")] = "",
    namespaced_tf: Annotated[
        bool, typer.Option("--namespaced-tf", help="With --ros2: write unprefixed frames to /ROBOT/tf.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing OUT, file or bag.")] = False,
) -> None:
    """Convert a recording for Foxglove: scene, frames, poses, robots and log.

    With --ros2 write a bag for ROS 2: odometry, scans, joints, frames, maps and clock."""
    only_for("--ros2", ros2, context, "robots", "namespaced_tf")
    with reporting("convert"):
        check_output(out, [recording], replace=force)
        require_extra("ros2" if ros2 else "foxglove", "bags of ROS 2" if ros2 else "recordings for Foxglove")
        from robocorba.simulation.recording import Recording

        if ros2:
            from robocorba.bridges.ros2 import bag
            from robocorba.bridges.ros2.frames import Frames

            bag.convert(Recording(recording), out, names_in(robots), Frames(namespaced_tf), overwrite=force)
        else:
            from robocorba.bridges.foxglove import files

            files.convert(Recording(recording), out, overwrite=force)
        size = sum(file.stat().st_size for file in (out.iterdir() if out.is_dir() else [out]))
        echo(f"wrote {out}: {size} bytes")
