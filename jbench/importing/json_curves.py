"""JSON files with the learning curves of many runs, as HumanoidBench and DreamerV3 publish them."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import pandas as pd
from pydantic import BaseModel, Field, FiniteFloat, TypeAdapter, ValidationError

from jbench.errors import RequestError
from jbench.importing.imported_file import ImportedFile
from jbench.importing.request import parse_seed

_Curves = TypeVar("_Curves")


class _Curve(BaseModel):
    """A curve in the JSON of HumanoidBench."""

    million_steps: list[FiniteFloat]
    returns: list[FiniteFloat] = Field(alias="return")


class _ListedCurve(BaseModel):
    """A curve in the JSON of DreamerV3's scores, which is a list of them."""

    task: str
    method: str
    seed: str | int
    xs: list[FiniteFloat]
    ys: list[FiniteFloat]


_JSON = '{task: {method: {"seed_0": {"million_steps": [...], "return": [...]}}}}'
_CURVES = TypeAdapter(dict[str, dict[str, dict[str, _Curve]]])
_LISTED_JSON = '[{"task": ..., "method": ..., "seed": ..., "xs": [steps], "ys": [returns]}]'
_LISTED_CURVES = TypeAdapter(list[_ListedCurve])


def curves_by_task(file: ImportedFile) -> pd.DataFrame:
    """Reads the JSON of HumanoidBench; returns the columns task, method, seed, steps and return.

    Raises a RequestError if the file has another form, or no curves.
    """
    curves = _validated(file, _CURVES, _JSON)
    parts = []
    for task, methods in curves.items():
        for method, curves_by_seed in methods.items():
            for name, curve in curves_by_seed.items():
                where = f"{file.path}: {method[:40]!r} on {task[:40]!r}, {name[:40]!r}"
                seed = parse_seed(name.removeprefix("seed_"), f"{where}: the seed is")
                if not len(curve.million_steps) == len(curve.returns) > 0:
                    raise RequestError(
                        f"{where}: million_steps and return must be as many finite numbers."
                    )

                steps = (np.array(curve.million_steps) * 1e6).round()
                labels = {"task": task, "method": method, "seed": seed}
                parts.append(pd.DataFrame({**labels, "steps": steps, "return": curve.returns}))

    return _joined(parts, file)


def listed_curves(file: ImportedFile) -> pd.DataFrame:
    """Reads the JSON of DreamerV3's scores; returns and raises as `curves_by_task`."""
    curves = _validated(file, _LISTED_CURVES, _LISTED_JSON)
    parts = []
    for number, curve in enumerate(curves, 1):
        where = f"{file.path}, curve {number}"
        if not len(curve.xs) == len(curve.ys) > 0:
            raise RequestError(f"{where}: xs and ys must be as many finite numbers.")

        seed = parse_seed(str(curve.seed), f"{where}: the seed is")
        labels = {"task": curve.task, "method": curve.method, "seed": seed}
        parts.append(pd.DataFrame({**labels, "steps": curve.xs, "return": curve.ys}))

    return _joined(parts, file)


def _validated(file: ImportedFile, kind: TypeAdapter[_Curves], form: str) -> _Curves:
    """Returns the curves in a file; raises a RequestError that says the form if it has another."""
    try:
        return kind.validate_json(file.content)
    except ValidationError as error:
        first = error.errors(include_input=False)[0]

    where = "".join(f"{part!r:.42}: " for part in first["loc"])
    raise RequestError(
        f"{file.path} is no JSON file of curves, which is {form}: {where}{first['msg']}."
    )


def _joined(parts: Sequence[pd.DataFrame], file: ImportedFile) -> pd.DataFrame:
    """Returns the curves of a file as one frame; raises a RequestError if there is none."""
    if not parts:
        raise RequestError(f"{file.path} has no curves; leave the file out.")

    return pd.concat(parts, ignore_index=True)
