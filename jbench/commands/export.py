"""The export command: policies, datasets and curves in formats that other tools read."""

import importlib.util
from pathlib import Path
from typing import Literal

from typer import Argument, Option

from jbench import names
from jbench.commands import options, output, parsing
from jbench.commands.policies import accepted_code, database_and_policy, mark
from jbench.errors import RequestError
from jbench.wording import counted, in_prose, repair_hint

_OPTIONS = {
    "onnx": ("RUN", "--inputs", "--format", "--out", "--accept-changed-code"),
    "minari": ("--dataset", "--task", "--format", "--out"),
    "croissant": ("--dataset", "--format", "--out"),
    "--curves": ("--task", "--returns"),
}


def export(
    run: str | None = Argument(
        None,
        metavar="RUN",
        help="Id of a run, to export its policy (default: export a dataset, or --curves).",
        autocompletion=options.complete_policies,
    ),
    dataset: str | None = options.DATASET,
    task: str | None = options.some_task(
        None,
        help="Task whose observations and rewards a dataset is exported with (default: "
        "face_direction, or the task of another robot's --dataset), or whose curves are exported "
        "(default: all).",
    ),
    format: Literal["onnx", "minari", "croissant"] | None = Option(
        None,
        help="Output format: onnx (of a policy, the default with RUN), minari (of a dataset, the "
        "default without), or croissant (metadata and tables of the results, or of --dataset).",
    ),
    inputs: Literal["si", "observation"] | None = Option(
        None,
        help="Input of an exported policy: si (features in SI units, the default for the "
        "Jitterbug) or observation (that of the environment, the default for other robots).",
    ),
    curves: Path | None = Option(
        None,
        parser=parsing.path,
        metavar="FILE",
        help="Write the learning curves of all runs to this file, as the JSON of HumanoidBench: "
        "task, method, seed_0, million_steps and return.",
    ),
    returns: names.ReturnsName | None = Option(
        None, help="Returns of --curves: evaluation (the default) or training."
    ),
    out: Path | None = Option(
        None,
        parser=parsing.path,
        help="File of the policy (default: RESULTS/onnx/RUN.onnx), or directory of Minari datasets "
        "(default: RESULTS/minari), or of metadata and tables (default: RESULTS/croissant).",
    ),
    accept_changed_code: bool = options.ACCEPT_CHANGED_CODE,
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Export a policy, a dataset, learning curves, or results with metadata.

    Formats: ONNX, Minari, the JSON of HumanoidBench, Croissant.
    """
    if curves is not None:
        kind = "--curves"
    elif format is not None:
        kind = format
    elif run is not None:
        kind = "onnx"
    else:
        kind = "minari"

    typed = {
        "RUN": run,
        "--dataset": dataset,
        "--task": task,
        "--format": format,
        "--inputs": inputs,
        "--returns": returns,
        "--out": out,
        "--accept-changed-code": accept_changed_code or None,
    }
    for option, value in typed.items():
        if value is not None and option not in _OPTIONS[kind]:
            permitted = in_prose(_OPTIONS[kind], "and")
            raise RequestError(f"{option} is not for {kind}, which has {permitted}; leave it out.")

    if curves is not None:
        _curves(curves, returns or "evaluation", task, results)
    elif kind == "croissant":
        _croissant(dataset, out, results)
    elif kind == "minari":
        _dataset(dataset, task, out, results)
    elif run is None:
        raise RequestError("--format onnx exports the policy of a run; type jbench export RUN.")
    else:
        _policy(run, inputs, out, results, accept_changed_code)


def _curves(file: Path, returns: names.ReturnsName, task: str | None, results: Path) -> None:
    """Writes the learning curves of all configurations to a file."""
    import pandas as pd

    from jbench.importing.curves import to_json
    from jbench.report.data import sources
    from jbench.report.data.configuration import with_returns
    from jbench.report.request import Request
    from jbench.store.files import check_output, write_atomic

    database = parsing.results_to_read(results)
    task = task and parsing.known_or_held("task", task, [database])
    check_output(file, "--curves")
    read = sources.own_and_imported(database, Request(task=task))
    chosen = with_returns(read.configurations, returns)
    if not chosen:
        (other,) = {*names.RETURNS} - {returns}
        raise RequestError(f"No run has {returns} returns; type --returns {other}.")

    curves = []
    for config in chosen:
        for seed, (steps, achieved) in zip(config.seeds, config.points, strict=True):
            named = {"task": config.task, "method": config.label, "seed": seed}
            curves.append(pd.DataFrame({**named, "steps": steps, "return": achieved}))

    points = pd.concat(curves)
    write_atomic(file, to_json(points).encode())
    output.say(
        f"Exported the {returns} returns of {counted(len(curves), 'run')} to {file}: task, method, "
        "seed, million_steps and return."
    )
    output.document({"path": file, "returns": returns, "runs": len(curves), "points": len(points)})
    output.warn_of_damage(read.problems, repair_hint(database.name))


def _policy(
    run: str, inputs: str | None, out: Path | None, results: Path, accept_changed: bool
) -> None:
    """Writes the policy of a run for ONNX Runtime."""
    for package in ("onnx", "onnxscript"):
        if importlib.util.find_spec(package) is None:
            raise RequestError(f"--format onnx needs {package}: type pip install 'jbench[onnx]'.")

    from jbench.policies.located import locate_run
    from jbench.policies.onnx_export import export_onnx
    from jbench.policies.saved import load_agent
    from jbench.store.files import check_output
    from jbench.tasks.find import find_task

    database, name = database_and_policy(results, run)
    if out is not None:
        check_output(out)

    located = locate_run(database, name)
    id = located.id
    agent = load_agent(located.results, id, accept_changed)
    if inputs is None:
        in_si_units = find_task(agent.task).units is not None
    else:
        in_si_units = inputs == "si"

    path = out or database.path / "onnx" / f"{id}.onnx"
    difference = export_onnx(agent, id, path, in_si_units)
    size = path.stat().st_size
    accepted = accepted_code(database, name, accept_changed)
    input_of_policy = "the observation of the environment"
    if in_si_units:
        input_of_policy = "features in SI units"

    output.say(
        f"Exported the policy of {id} for {agent.task}{mark(accepted)}: {size / 1e3:.0f} kB in "
        f"{path}. Its input is {input_of_policy}; its actions differ from the policy's by at most "
        f"{difference:.1g}."
    )
    document = {"run": id, "task": agent.task, "path": path}
    output.document({**document, "bytes": size, "difference": difference, "accepted": accepted})


def _croissant(dataset: str | None, out: Path | None, results: Path) -> None:
    """Writes the metadata of results, or of a dataset."""
    if importlib.util.find_spec("mlcroissant") is None:
        raise RequestError(
            "--format croissant needs mlcroissant: type pip install 'jbench[croissant]'."
        )

    from jbench.archive.croissant import METADATA, write_croissant
    from jbench.datasets import find_dataset

    database = parsing.results_to_read(results)
    record = None
    if dataset is not None:
        record = find_dataset(database, dataset).record

    folder = out or results / "croissant"
    if out is None and names.is_reference(results):
        folder = Path(f"{names.REFERENCE}-croissant")

    written = write_croissant(database, folder, record)
    output.say(
        f"Wrote {counted(len(written) - 1, 'table')} and {METADATA} to {folder}; "
        f"mlcroissant.Dataset(jsonld='{folder / METADATA}') reads them."
    )
    output.document({"path": folder / METADATA, "files": written})


def _dataset(dataset: str | None, task: str | None, out: Path | None, results: Path) -> None:
    """Writes a dataset for offline reinforcement learning (Minari)."""
    from jbench.datasets import find_dataset
    from jbench.datasets.export import export_minari

    database = parsing.results_to_write(results)
    if task is None:
        source = find_dataset(database, dataset)
    else:
        source = find_dataset(database, dataset, task)

    task = task or source.layout.task
    root = out or results / "minari"
    with output.progress(f"export {task}", source.episodes, "episodes") as progress:
        id, size = export_minari(source, task, root, progress)

    output.say(
        f"Exported {source.id} with the observations of {task}: "
        f"{counted(source.episodes, 'episode')}, "
        f"{size / 1e6:.1f} MB, in {root / id}. With MINARI_DATASETS_PATH={root}, Minari "
        f'loads it by minari.load_dataset("{id}").'
    )
    document = {"dataset": source.id, "task": task, "path": root / id, "minari_id": id}
    output.document(document)
