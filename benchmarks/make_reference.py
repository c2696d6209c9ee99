"""Keeps the rows of finished runs as reference: `python benchmarks/make_reference.py RESULTS`.

Copies manifests and tables of the finished runs of a results directory into `jbench/reference/`,
which is shipped with jbench and shown by `jbench report --reference`. Policies are left out: they
are most of a run's bytes. Encoders, which runs on latents name, are left out too, and so is what
was typed, which names places on the machine that made them. What is there already stays.
"""

import argparse
from pathlib import Path

from jbench.store import Record, Results, files
from jbench.store.manifest import MANIFEST

REFERENCE = Path(__file__).parents[1] / "jbench" / "reference"


def keep(record: Record, target: Results) -> None:
    """Copies the rows of a run, and a manifest that lists them alone."""
    manifest = record.manifest
    rows = tuple(entry for entry in manifest.files if entry.table is not None)
    path = target.record("run", record.id).path
    files.make_directory(path)
    for entry in rows:
        files.copy_atomic(record.path / entry.name, path / entry.name, entry.sha256)
    known = {name: said for name, said in manifest.provenance.items() if name != "command"}
    kept = manifest.model_copy(update={"files": rows, "provenance": known})
    files.write_atomic(path / MANIFEST, kept.to_bytes())
    print(f"{record.id}: {record.rows('episodes')} episodes")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("--out", type=Path, default=REFERENCE)
    arguments = parser.parse_args()
    target = Results(arguments.out)
    records, problems = Results(arguments.results).scan("run")
    for record in records:
        if record.status == "finished" and target.find("run", record.id) is None:
            keep(record, target)
    for problem in problems:
        print(problem)


if __name__ == "__main__":
    main()
