"""Arms of a study: what each of its configurations has in common, whatever its seeds."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from jbench.errors import RequestError
from jbench.names import SettingsBase
from jbench.representation_names import FULL, kind_in, shown_representation
from jbench.settings.algorithms import (
    SETTINGS,
    default_base,
    default_time_limit,
    own_algorithm_fields,
)
from jbench.settings.base import canonical_json, in_id, task_and_representation, validated
from jbench.settings.evaluations import evaluation_schedule
from jbench.settings.recorded import Run, comparable
from jbench.settings.records import requested_ofe
from jbench.settings.run import RunSettings
from jbench.settings.specs import Specs, episode_steps
from jbench.studies.file import refusals_named
from jbench.studies.matrix import Matrix, Parts
from jbench.task_specs import has_specs


@dataclass(frozen=True)
class Arm:
    """The runs of a study with the same settings, except for their seeds.

    Attributes:
        where: the part of the file, for errors.
        representation: as the file names it: `planar`, `dae12`, or the id of an encoder.
    """

    where: str
    part: Matrix
    task: str
    algo: str
    representation: str

    @property
    def short_name(self) -> str:
        """The representation without a size that follows from the task, such as `planar`."""
        return short_name(self.representation)

    @property
    def base(self) -> SettingsBase:
        """The source of the hyperparameters, of which single ones may differ."""
        return default_base(self.task, self.part.settings)

    @property
    def own_encoders(self) -> bool:
        """Whether each agent has an encoder of its own."""
        return self.part.encoder.seed == "each" and self._has_encoder_to_train

    @property
    def _has_encoder_to_train(self) -> bool:
        """Whether a sweep trains the encoder: it is not given, and features are no encoder."""
        is_given = self.representation == FULL or "/" in self.representation
        return not is_given and self.fields["ofe"] is None

    @cached_property
    def fields(self) -> dict[str, Any]:
        """Fields of `RunSettings` that all runs share, except for those of an encoder.

        Raises a RequestError if the algorithm, a hyperparameter or the task is unknown or invalid.
        """
        typed = self.part.run_fields
        specs = _specs(self.task)
        every, episodes = evaluation_schedule(
            typed["steps"],
            episode_steps(specs),
            typed["evaluate_every"],
            typed["evaluate_episodes"],
        )
        return {
            **typed,
            **self._algorithm_fields(),
            "task": self.task,
            "specs": specs,
            "time_limit": typed["time_limit"] or default_time_limit(self.part.settings),
            "evaluate_every": every,
            "evaluate_episodes": episodes,
            "encoder": None,
            "ofe": requested_ofe(self.representation, self.part.ofe),
        }

    def _algorithm_fields(self) -> dict[str, Any]:
        """The fields of `RunSettings` that describe the algorithm."""
        overrides = self.part.hyperparameters.get(self.algo)
        if self.algo in SETTINGS:
            return own_algorithm_fields(self.algo, self.part.engine, self.base, overrides)

        # Algorithms of other packages need torch.
        from jbench.agents.algorithms import algorithm_fields

        return algorithm_fields(
            self.algo, self.part.engine, self.part.settings, overrides, self.task
        )

    @cached_property
    def run(self) -> RunSettings:
        """The settings of a run of this arm as if it had no encoder."""
        ofe = self.fields["ofe"]
        name = FULL if ofe is None else ofe.representation
        fields = self.fields | {"representation": name, "seed": 0}
        return validated(RunSettings, "the run", **fields)

    @cached_property
    def key(self) -> str:
        """A key that is equal to `run_key` of the runs of this arm."""
        return _key(self.run, self.short_name, self.own_encoders, self.run.steps)

    @property
    def evaluation(self) -> tuple[int, int]:
        """Control steps between evaluations of a run, and the episodes of each."""
        return self.run.evaluate_every, self.run.evaluate_episodes

    @property
    def training_key(self) -> str:
        """A key that is equal for arms with the same training, whose encoders are trained alike.

        Their runs are the same, unless their evaluations differ. Options that a part has for other
        kinds of encoders do not count.
        """
        trained = None
        if self._has_encoder_to_train:
            part = self.part.model_dump(mode="json")
            encoder = part["encoder"]
            options = encoder["options"].get(kind_in(self.representation))
            trained = [encoder["seed"], options, part["dataset"]]

        return canonical_json({"arm": [self.key, trained]})


def run_key(run: Run, steps: int) -> str:
    """Returns a key of recorded runs of some control steps that are of one arm; see `Arm.key`.

    It does not depend on which encoder a run has, only on its name, and whether each seed has one
    of its own.
    """
    own_encoders = getattr(run, "encoder_draws", None) is not None
    return _key(run, short_name(str(run.representation)), own_encoders, steps)


def _key(run: Run, representation: str, own_encoders: bool, steps: int) -> str:
    """Returns a key that is equal for runs of one arm, whatever their seeds and encoders."""
    ofe = getattr(run, "ofe", None)
    features = None if ofe is None else ofe.values
    rest = comparable(run, "representation")
    return canonical_json({"run": [rest, representation, own_encoders, features, steps]})


def short_name(representation: str) -> str:
    """Returns the name of a representation, or of an encoder's id, as reports show it."""
    name = representation
    if "/" in representation:
        _, name = task_and_representation(representation)
    return shown_representation(name.replace(":", "", 1))


def arms(parts: Parts) -> Iterator[Arm]:
    """Yields the arms of the parts of a matrix in the order of the file, grouped by task.

    Some may be equal, also by another name: planar is planar12. Raises a RequestError if an encoder
    that is given by its id is of another task.
    """
    for where, part in parts.items():
        with refusals_named(where):
            for name in part.representations:
                if "/" not in name:
                    continue
                task, _ = task_and_representation(name)
                if task not in map(in_id, part.tasks):
                    raise RequestError(
                        f"the encoder {name} is of {task}, which is not in tasks; add it to them, "
                        "or choose another encoder."
                    )

        for task in part.tasks:
            for algo in part.algos:
                for name in part.representations:
                    if "/" not in name or task_and_representation(name)[0] == in_id(task):
                        yield Arm(where, part, task, algo, name)


def _specs(task: str) -> Specs | None:
    """Returns what identifies the robot of a task; None for the Jitterbug."""
    if not has_specs(task):
        return None
    from jbench.tasks.find import find_task  # imports MuJoCo

    return find_task(task).specs
