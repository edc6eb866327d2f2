"""robocorba samples, and what begins with one of them: the maps, programs and fleets that travel with RoboCorba."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import Force, Json
from robocorba.commands.reporting import reporting
from robocorba.commands.tables import Sheet, print_json, show
from robocorba.errors.files import OutputError
from robocorba.map_editor.samples import sample_files
from robocorba.system.output_files import write_outputs
from robocorba.system.printing import echo

app = typer.Typer(no_args_is_help=True)


@app.command("list")
def list_samples(json: Json = False) -> None:
    """List the samples: maps, a fleet, programs."""
    if json:
        print_json(list(sample_files()))
    else:
        show(Sheet(["sample"], [(name,) for name in sample_files()]))


@app.command()
def copy(
    sample: Annotated[str, typer.Argument(help="Name that `list` shows.", autocompletion=lambda: [*sample_files()])],
    output: Annotated[Path, typer.Argument(metavar="[OUT]", help="File or folder. Default: here.")] = Path(),
    force: Force = False,
) -> None:
    """Copy a sample to edit it."""
    with reporting("samples copy", OSError):
        if sample not in sample_files():
            raise OutputError(sample, f"there is no such sample; there are {', '.join(sample_files())}")
        _write(output / sample if output.is_dir() else output, sample_files()[sample].read_text(), force)


def add_new(app: typer.Typer, sample: str, what: str) -> None:
    """Give a command `new` to `app`, which writes a sample under the name of its output."""

    @app.command("new", help=f"Write a sample to start from: {what}.")
    def new(output: Annotated[Path, typer.Argument(metavar="OUT", help="New file.")], force: Force = False) -> None:
        with reporting("new", OSError):
            text = sample_files()[sample].read_text()
            _write(output, text.replace(Path(sample).stem, output.stem, 1), force)


def _write(output: Path, text: str, force: bool) -> None:
    write_outputs({output: text.encode()}, replace=force)
    echo(f"wrote {output}")
