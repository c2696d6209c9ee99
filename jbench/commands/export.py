"""The export command: policies and datasets in formats that other tools read."""

import importlib.util
from pathlib import Path
from typing import Annotated

import typer

from jbench import names
from jbench.commands import parsing
from jbench.commands.options import (
    RESULTS,
    DatasetOption,
    JsonOption,
    ReadResultsOption,
    complete,
    complete_policies,
    complete_tasks,
    path,
)
from jbench.commands.output import Output
from jbench.commands.policies import database_and_policy
from jbench.errors import RequestError

FORMATS = ("onnx", "minari")
"""Formats of policies (onnx) and of datasets (minari)."""

_TASK = "face_direction"

INPUTS = ("si", "observation")
"""Inputs of an exported policy: features in SI units, or the observation of the environment."""


def export(
    run: Annotated[
        str | None,
        typer.Argument(
            metavar="RUN",
            help="Id of a run, to export its policy (default: export a dataset).",
            autocompletion=complete_policies,
        ),
    ] = None,
    dataset: DatasetOption = None,
    task: Annotated[
        str | None,
        typer.Option(
            help="Task whose observations and rewards a dataset is exported with (default: "
            "face_direction, or the task of another robot's --dataset).",
            autocompletion=complete_tasks,
        ),
    ] = None,
    format: Annotated[
        str | None,
        typer.Option(
            help="Output format: onnx (of a policy, the default with RUN) or minari (of a "
            "dataset, the default without).",
            autocompletion=complete(*FORMATS),
        ),
    ] = None,
    inputs: Annotated[
        str | None,
        typer.Option(
            help="Input of an exported policy: si (features in SI units, the default for the "
            "Jitterbug) or observation (that of the environment, the default for other robots).",
            autocompletion=complete(*INPUTS),
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            parser=path,
            help="File of the policy (default: RESULTS/onnx/RUN.onnx), or directory of Minari "
            "datasets (default: RESULTS/minari).",
        ),
    ] = None,
    results: ReadResultsOption = RESULTS,
    json: JsonOption = False,
) -> None:
    """Export a policy as ONNX, or a dataset for Minari."""
    chosen = format or ("minari" if run is None else "onnx")
    names.known("value of --format", chosen, FORMATS)
    if inputs is not None:
        names.known("value of --inputs", inputs, INPUTS)
    output = Output(json)
    if chosen == "minari":
        if run is not None:
            raise RequestError(f"{run}: RUN is for --format onnx; name a dataset with --dataset.")
        if inputs is not None:
            raise RequestError("--inputs is for policies; name a run, or leave it out.")
        _dataset(dataset, task, out, results, output)
    elif run is None:
        raise RequestError("--format onnx exports the policy of a run; type jbench export RUN.")
    elif dataset is not None or task is not None:
        raise RequestError("--dataset and --task are for datasets; leave them out with RUN.")
    else:
        _policy(run, inputs, out, results, output)


def _policy(run: str, inputs: str | None, out: Path | None, results: Path, output: Output) -> None:
    if importlib.util.find_spec("onnx") is None:
        raise RequestError("--format onnx needs the package onnx; type pip install 'jbench[onnx]'.")
    from jbench.policies.find import find_trained_agent
    from jbench.policies.onnx_export import export_onnx
    from jbench.store.files import check_output

    database, name = database_and_policy(results, run)
    if out is not None:
        check_output(out)
    id, agent = find_trained_agent(database, name)
    in_si_units = None if inputs is None else inputs == "si"
    done = export_onnx(agent, id, out or database.path / "onnx" / f"{id}.onnx", in_si_units)
    what = "features in SI units" if done.in_si_units else "the observation of the environment"
    output.say(
        f"Exported the policy of {id} for {agent.task}: {done.bytes / 1e3:.0f} kB in {done.path}. "
        f"Its input is {what}; its actions differ from the policy's by at most "
        f"{done.difference:.1g}."
    )
    output.document(
        {
            "run": id,
            "task": agent.task,
            "path": str(done.path),
            "bytes": done.bytes,
            "difference": done.difference,
        }
    )


def _dataset(
    dataset: str | None, task: str | None, out: Path | None, results: Path, output: Output
) -> None:
    from jbench.datasets import find_dataset
    from jbench.datasets.export import export_minari
    from jbench.settings.dataset import JITTERBUG

    source = find_dataset(parsing.results_to_write(results), dataset, task or _TASK)
    if task is None:
        task = _TASK if source.robot == JITTERBUG else source.robot
    root = out or results / "minari"
    with output.progress(f"export {task}", source.episodes, "episodes") as progress:
        done = export_minari(source, task, root, progress)
    output.say(
        f"Exported {source.id} with the observations of {task}: {source.episodes:,} episodes, "
        f"{done.bytes / 1e6:.1f} MB, in {done.path}. With MINARI_DATASETS_PATH={root}, Minari "
        f'loads it by minari.load_dataset("{done.id}").'
    )
    output.document(
        {"dataset": source.id, "task": task, "path": str(done.path), "minari_id": done.id}
    )
