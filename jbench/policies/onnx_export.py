"""Trained policies as ONNX models, for programs without jbench."""

import importlib.metadata
import json
import logging
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pandas as pd
import torch
from onnx import checker, helper
from onnx.reference import ReferenceEvaluator
from torch import Tensor, nn

from jbench.errors import ERRORS_OF_OTHERS, RequestError, WorkError
from jbench.policies.saved import TrainedAgent
from jbench.store.files import make_directory, write_atomic
from jbench.tasks.find import find_task

_OPSET = 18
_IR_VERSION = 8  # of 2022, which ONNX Runtime reads from 1.14 on
_TOLERANCE = 1e-4  # of an action; float32 rounding in another order is a hundredth of that


def export_onnx(agent: TrainedAgent, run: str, path: Path, in_si_units: bool) -> float:
    """Writes the policy of a run as an ONNX model; returns the largest difference of their actions.

    The model has an input `observation` (robots, dim(O)) and an output `action` (robots, dim(A)),
    both float32. The scaling of the observation and the encoder are part of it. Its metadata
    describe the inputs and the outputs; see `metadata`. The input is the features in SI units, or
    the observation of the environment, in which the range of each feature of the Jitterbug is
    mapped to [-1, 1].

    Raises a RequestError if the encoder or the policy has an operation that can't be written, or
    the units of the observation are not known, and a WorkError if the model's actions differ from
    the policy's, or it can't be written.
    """
    task = find_task(agent.task)
    if in_si_units and task.units is None:
        raise RequestError(
            f"The units of the observations of {agent.task} are not known: type --inputs "
            "observation."
        )

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that are deprecated within torch
        model = _model(agent, run, in_si_units)

    helper.set_model_props(model, metadata(agent, run, in_si_units))
    checker.check_model(model, full_check=True)
    # Compared over observations from the ranges of the features.
    shape = 256, task.observation_size
    observations = np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)
    inputs = task.physical(observations) if in_si_units else observations
    (actions,) = ReferenceEvaluator(model).run(None, {"observation": inputs})
    difference = float(np.abs(np.asarray(actions) - agent.act(observations)).max())
    if not difference < _TOLERANCE:
        raise WorkError(f"The ONNX model of {run} differs from its policy by {difference:.1e}.")

    make_directory(path.parent, "--out")
    write_atomic(path, model.SerializeToString())
    return difference


def metadata(agent: TrainedAgent, run: str, in_si_units: bool) -> dict[str, str]:
    """Returns the description of a model's inputs and output; structures are JSON.

    `inputs` has for each component of the observation its name; for the Jitterbug also its unit,
    and if the input is not in SI units the `minimum` and `maximum` in that unit that are mapped to
    -1 and 1. `outputs` has the bounds of each action, and what they are for the actuator.
    """
    task = find_task(agent.task)
    inputs: dict[str, Sequence[Any]] = {"name": task.labels}
    outputs: dict[str, Any] = {"name": task.action_labels, "minimum": -1.0, "maximum": 1.0}
    scaling = "none"
    if task.units is not None:
        inputs["unit"] = task.units
        scaling = "SI units"
    if task.observed_range is not None and not in_si_units:
        inputs["minimum"], inputs["maximum"] = task.observed_range
        scaling = "minimum to -1, maximum to 1"

    if task.specs:
        outputs["actuator_minimum"] = task.specs.action_minimum
        outputs["actuator_maximum"] = task.specs.action_maximum
    else:
        outputs = {"name": ["motor_command"], "unit": "1", "minimum": -1.0, "maximum": 1.0}

    return {
        "inputs": json.dumps(pd.DataFrame(inputs).to_dict("records")),
        "outputs": json.dumps(pd.DataFrame(outputs).to_dict("records")),
        "input_scaling": scaling,
        "control_timestep": json.dumps({"value": task.control_timestep, "unit": "s"}),
        "task": agent.task,
        "run": run,
        "jbench": importlib.metadata.version("jbench"),
    }


def _model(agent: TrainedAgent, run: str, in_si_units: bool) -> onnx.ModelProto:
    """Returns the graph of a policy with its preprocessing."""
    task = find_task(agent.task)

    class Actor(nn.Module):
        def forward(self, inputs: Tensor) -> Tensor:
            """Returns the actions of inputs (robots, size)."""
            observations = task.observed(inputs) if in_si_units else inputs
            actions: Tensor = agent.act(observations)
            return actions

    # The exporter warns of operators of torchvision, which is not installed.
    logging.getLogger("torch.onnx._internal.exporter._registration").setLevel(logging.ERROR)
    example = torch.zeros(2, task.observation_size)
    shapes = ({0: torch.export.Dim("robots")},)
    options: Any = {
        "input_names": ["observation"],
        "output_names": ["action"],
        "opset_version": _OPSET,
        "verbose": False,
    }
    try:
        Actor()(example)  # so that constants which are made once are not made while it is traced
        traced = torch.export.export(Actor(), (example,), dynamic_shapes=shapes)
        program = torch.onnx.export(traced, dynamic_shapes=shapes, **options)
    except ERRORS_OF_OTHERS as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0].rstrip(".")
        raise RequestError(
            f"The run {run} can't be exported to ONNX: torch can't trace its encoder or policy "
            f"({reason})."
        ) from None

    assert program is not None
    model = program.model_proto
    graph = model.graph
    model.ir_version = _IR_VERSION
    model.producer_name = "jbench"
    model.producer_version = ""
    del graph.value_info[:]
    for part in (graph, *graph.node, *graph.initializer, *graph.input, *graph.output):
        del part.metadata_props[:]  # such as the paths of source files

    return model
