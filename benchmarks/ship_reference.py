"""Adds finished runs to the package: `python benchmarks/ship_reference.py RESULTS`.

Copies the rows and policies of the finished runs of a results directory into `jbench/reference/`,
with all finished encoders and the evaluations of shipped policies (`jbench evaluate RUN`); with
`--policies 0-3` the policies of these seeds only. `jbench report --results reference` shows them,
and `jbench render reference/ID` a policy. The wheel has every row, and the policies that
`jbench/store/kept_policies.txt` names, at most ten; all others are in the repository alone.
Checkpoints are left out, and so is the command of a run, which names directories. A run whose
manifest still names one is refused.

Shipped runs stay as they are. Run the script again after more runs have finished.
"""

import argparse
import io
import re
import sys
import zipfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from jbench.policies.network import DESCRIPTION, WEIGHTS
from jbench.store import Record, Results, files
from jbench.store.manifest import FileEntry, Manifest
from jbench.store.rows import has_policy
from jbench.store.shipped import may_lack, shipped
from jbench.store.verify import examine
from jbench.typed_values import parse_numbers

POLICY = {DESCRIPTION, WEIGHTS}
LARGEST_PACKAGE = 12_000_000  # bytes of its wheel
_LOCAL_PATH = re.compile(r"""(?:^|[\s"'=:(])(?:~?/\w|[A-Za-z]:\\)""")


def strings(value: Any) -> Iterator[str]:
    """Gives every string in a JSON value, names of fields included."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for name, inner in value.items():
            yield from strings(name)
            yield from strings(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from strings(inner)


def public(manifest: Manifest) -> Manifest:
    """Returns a manifest as it is shipped: without the command and without checkpoints.

    Raises:
        ValueError: if it names a directory of the machine that made it.
    """
    provenance = {name: said for name, said in manifest.provenance.items() if name != "command"}
    kept = tuple(entry for entry in manifest.files if entry.role is None)
    changed = manifest.model_copy(update={"provenance": provenance, "files": kept})
    local = next(filter(_LOCAL_PATH.search, strings(changed.model_dump())), None)
    if local is not None:
        raise ValueError(f"its manifest names a directory of the machine that made it: {local!r}")
    return changed


def last_return(run: Record) -> float | None:
    """Returns the mean return of a run's last evaluation, or None if it has none."""
    rows = run.read("evaluations").to_pandas()
    if rows.empty:
        return None
    return float(rows.loc[rows["evaluation"] == rows["evaluation"].max(), "episode_return"].mean())


def copy(record: Record, target: Results, listed: tuple[FileEntry, ...]) -> None:
    """Copies some files of a record, and a manifest that lists these alone."""
    manifest = public(record.manifest).model_copy(update={"files": listed})
    folder = target.folder(record.kind, record.id)
    files.make_directory(folder.path)
    for entry in listed:
        if record.path != folder.path:
            files.write_atomic(folder.path / entry.name, record.read_file(entry.name))
    Record.begin(folder, manifest)


def ship_encoder(id: str | None, source: Results, target: Results) -> bool:
    """Ships the encoder of a run if it is not shipped yet.

    Returns:
        Whether the shipped encoder is the one that the run's policy was trained on: encoders of one
        id, trained on two processors, may differ in their last digits.
    """
    if id is None:
        return True
    own, there = source.find("encoder", id), target.find("encoder", id)
    if own is None or not own.is_finished:
        return False
    if there is None:
        copy(own, target, public(own.manifest).files)
        return True
    weights = [
        {entry.name: entry.sha256 for entry in encoder.manifest.files if entry.table is None}
        for encoder in (own, there)
    ]
    return weights[0] == weights[1]


def ship(source: Results, target: Results, policies: Collection[int] | None = None) -> list[str]:
    """Adds the finished runs of the source to the target, with the policies of all or some seeds.

    Returns:
        A sentence for each run that is left out or goes without its policy.
    """
    records, notes = source.scan("run")
    before = {run.id: run for run in target.scan("run")[0]}
    for encoder in source.scan("encoder")[0]:
        ship_encoder(encoder.id, source, target)
    for run in records:
        if run.id in before:
            continue
        try:
            check(run, source)
        except ValueError as reason:
            notes.append(f"{run.id} is left out: {reason}.")
            continue
        listed = public(run.manifest).files
        equal = ship_encoder(run.settings["encoder"], source, target)
        if not equal:
            notes.append(f"{run.id}: without its policy, as the shipped encoder is another one.")
        if not equal or (policies is not None and run.settings["seed"] not in policies):
            listed = tuple(entry for entry in listed if entry.name not in POLICY)
        copy(run, target, listed)
    evaluable = {run.id for run in target.scan("run")[0] if has_policy(run)}
    for evaluation in source.scan("evaluation")[0]:
        if evaluation.is_finished and evaluation.settings["policy"] in evaluable:
            copy(evaluation, target, public(evaluation.manifest).files)
    return notes


def check(run: Record, source: Results) -> None:
    """Checks that a run can be shipped.

    Raises:
        ValueError: if it has not finished, is damaged or names a directory; it says which.
    """
    if not run.is_finished:
        raise ValueError(f"it is {run.status}")
    damage = [found for found in examine(source, "run", run.id)[1] if found.sort != "leftover"]
    if damage:
        raise ValueError(str(damage[0]).removesuffix("."))
    public(run.manifest)


def size(directory: Path) -> int:
    """Returns how many bytes a wheel of the files of a directory has, with their names.

    Compiled Python and the policies that the wheel leaves out do not count, and neither does the
    list of files that a wheel has (0.1 MB).
    """
    runs = shipped() / "runs"
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as wheel:
        for path in directory.rglob("*"):
            if not path.is_file() or "__pycache__" in path.parts:
                continue
            is_shipped = path.is_relative_to(runs)
            if is_shipped and path.name in may_lack(path.parent.relative_to(runs).as_posix()):
                continue
            wheel.write(path, path.relative_to(directory.parent))

    return content.getbuffer().nbytes


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("--policies", type=parse_numbers, metavar="SEEDS")
    parser.add_argument("--out", type=Path, default=shipped())
    arguments = parser.parse_args()
    target = Results(arguments.out)
    for sentence in ship(Results(arguments.results), target, arguments.policies):
        print(sentence)
    runs = target.scan("run")[0]
    for run in filter(has_policy, runs):
        print(f"reference/{run.id}: last evaluation {last_return(run):.0f}")
    package = size(arguments.out.parent if arguments.out == shipped() else arguments.out)
    print(f"{len(runs)} runs; {package / 1e6:.1f} MB in a wheel.")
    if package > LARGEST_PACKAGE:
        print(f"That is more than {LARGEST_PACKAGE / 1e6:.0f} MB.", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
