"""The archive command."""

from pathlib import Path

from typer import Argument, Option

from jbench.commands import options, output, parsing
from jbench.wording import counted


def archive(
    results: Path = Argument(
        ..., parser=parsing.path, metavar="RESULTS", help="Results directory, or reference."
    ),
    out: Path = Option(..., parser=parsing.path, metavar="FILE", help="Zip file to write."),
    blind: bool = Option(
        False,
        "--blind",
        help="Without names: of people, machines, directories, packages and modules.",
    ),
    json: bool = options.JSON,
) -> None:
    """Write a zip file for reviewers: records, report, matrix and versions.

    It has no checkpoints and no datasets.
    """
    from jbench.archive.write import write_archive

    written = write_archive(parsing.results_to_read(results), out, blind)
    for line in written.left_out:
        output.warn(f"{line}; left out.")

    output.say(
        f"Wrote {written.path}: {counted(written.records, 'record')}, {written.bytes / 1e6:.1f} MB"
        f"{', without names' if blind else ''}."
    )
    output.document(written._asdict())
