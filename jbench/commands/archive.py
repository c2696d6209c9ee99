"""The archive command."""

from pathlib import Path

from typer import Argument, Option

from jbench import names
from jbench.commands import options, output, parsing
from jbench.errors import RequestError
from jbench.wording import counted, directory_name


def archive(
    directory: Path | None = Argument(
        None, parser=parsing.path, metavar="RESULTS", help="Results directory, as --results."
    ),
    out: Path | None = Option(
        None,
        parser=parsing.path,
        metavar="FILE",
        help="Zip file to write (default: RESULTS.zip in the working directory, with --blind "
        "RESULTS-blind.zip).",
    ),
    blind: bool = Option(
        False,
        "--blind",
        help="Without names: of people, machines, directories, packages and modules.",
    ),
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Write a zip file for reviewers: records, report, matrix and versions.

    It has no checkpoints and no datasets.
    """
    from jbench.archive.write import write_archive

    if directory is not None and results != Path(names.RESULTS):
        raise RequestError(f"Type either {directory} or --results {results}, not both.")

    chosen = directory or results
    database = parsing.results_to_read(chosen)
    written = write_archive(database, out or _default_file(chosen, blind), blind)
    for line in written.left_out:
        output.warn(f"{line}; left out.")

    content = f"{counted(written.records, 'record')}, {written.bytes / 1e6:.1f} MB"
    if blind:
        content += ", without names"

    output.say(f"Wrote {written.path}: {content}.")
    output.document(written._asdict())


def _default_file(results: Path, blind: bool) -> Path:
    """Returns a file in the working directory that is named after a results directory."""
    name = directory_name(results)
    if blind:
        name += "-blind"

    return Path(f"{name}.zip")
