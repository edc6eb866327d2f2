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
    recording: Annotated[Path, typer.Argument(metavar="IN", help="A recording of `robocorba record`.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The MCAP file with Foxglove's messages, or the bag.")],
    ros2: Annotated[bool, typer.Option("--ros2", help="Write a bag of ROS 2: a folder for `ros2 bag`.")] = False,
    robots: Annotated[str, typer.Option(metavar="A,B", help="With --ros2: only these robots.")] = "",
    namespaced_tf: Annotated[
        bool, typer.Option("--namespaced-tf", help="With --ros2: /ROBOT/tf with plain frames.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace OUT: a file, or a bag.")] = False,
) -> None:
    """Write a recording as an MCAP file with Foxglove's messages (scene, frames, poses, robots and log), or as a bag of
    ROS 2 (odometry, scans, joints, frames, maps and clock). What OUT has is only replaced with --force, IN never."""
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
