"""Tasks of dm_control's suite and any other `dm_env.Environment`, behind the interface of tasks.

Episodes are begun and stepped by the environment's own `reset` and `step`, one world after another:
observation and reward are Python, so threads would be slower. The only state is the seed of an
episode, since many tasks write random targets into their model at each reset.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from jbench.errors import RequestError, WorkError, sentence_of_failure
from jbench.names import EPISODE_STEPS
from jbench.settings.records import Specs
from jbench.sources import checksum
from jbench.tasks.robot_checksum import robot_checksum
from jbench.tasks.task import Task, Worlds, WorldsState

Make = Callable[[int], Any]  # returns a new `dm_env.Environment` with this seed

_ROUNDING = 1e-6  # by which rewards may exceed [0, 1]
_UNBOUNDED = 1e9  # dm_control writes 1e10 for an actuator without limits

# Fields of MuJoCo's model and its options by which two robots differ; not drawn ones, and none that
# a later version might add.
_PHYSICAL = """
body_parentid body_pos body_quat body_mass body_inertia body_ipos jnt_type jnt_axis jnt_pos
jnt_range jnt_stiffness dof_damping dof_armature dof_frictionloss geom_type geom_size geom_pos
geom_quat geom_friction geom_contype geom_conaffinity site_pos tendon_stiffness tendon_damping
actuator_gear actuator_gainprm actuator_biasprm actuator_ctrlrange actuator_forcerange
"""
_OPTIONS = ("timestep", "gravity", "wind", "density", "viscosity", "integrator")


class DmTask(Task):
    """A task that a `dm_env.Environment` implements; `reseeds`: it is not made again."""

    def __init__(
        self,
        name: str,
        make: Make,
        *,
        takes_random: bool = True,
        files: Mapping[str, str] | None = None,
    ) -> None:
        """Makes an environment and reads its specifications: RequestError if it is unusable.

        The seed must decide about its random numbers, or `takes_random` is false. `files` are those
        of a user's code, see `source_files`; None for a task of dm_control's suite, which its
        version describes.
        """
        self.name, self._make = name, make
        environment = self.environment(0)
        parts = environment.observation_spec()
        if not isinstance(parts, Mapping) or not parts or not all(parts):
            raise self._refusal("its observation has no names: return a dictionary of named arrays")
        self.parts = {str(name): int(np.prod(spec.shape)) for name, spec in parts.items()}
        self._minimum, self._maximum = self._read_bounds(environment)
        self.action_size = len(self._minimum)
        columns = ["episode", "step", *self.labels, *self.action_labels, "reward"]
        if twice := [name for name in columns if columns.count(name) > 1]:
            raise self._refusal(
                f"a dataset of it would have two columns {twice[0]}; rename that part of its "
                "observation"
            )
        random = getattr(getattr(environment, "task", None), "random", None)
        self.reseeds = isinstance(random, np.random.RandomState)
        if not self.reseeds and not takes_random:
            raise self._refusal(
                "its episodes can't be seeded: give its task a RandomState `random`, or its "
                "factory an argument `random`"
            )
        timestep = getattr(environment, "control_timestep", None)
        self.control_timestep = float(timestep()) if callable(timestep) else None
        self.specs = Specs(
            model=_model_hash(environment),
            parts=list(self.parts),
            sizes=list(self.parts.values()),
            action_minimum=self._minimum.tolist(),
            action_maximum=self._maximum.tolist(),
            control_timestep=self.control_timestep,
            compiled=None if files is None else robot_checksum(environment),
            sources=None if files is None else checksum(files),
        )
        _close(environment)

    def environment(self, seed: int) -> Any:
        """Returns a new environment; RequestError if it can't be made."""
        try:
            environment = self._make(seed)
        except (RequestError, WorkError):
            raise
        except Exception as error:
            raise self._refusal(f"it can't be made ({sentence_of_failure(error)})") from error
        wanted = ("reset", "step", "observation_spec", "action_spec")
        if not all(callable(getattr(environment, method, None)) for method in wanted):
            raise self._refusal(f"it is a {type(environment).__name__}, not a dm_env.Environment")
        return environment

    def worlds(self, count: int, threads: int = 1, augment: int | None = None) -> "DmWorlds":
        """Returns new worlds; see `Task.worlds`. They are stepped in the caller's thread."""
        if augment is not None:
            raise self._refusal("it has no augmented robots; leave them out")
        return DmWorlds(self, count)

    def commands(self, actions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Maps actions (..., action_size), clipped to [-1, 1], to the actuators' bounds."""
        clipped: NDArray[np.float64] = np.clip(actions, -1, 1).astype(np.float64)
        if (self._minimum == -1).all() and (self._maximum == 1).all():
            return clipped  # without rounding
        scaled: NDArray[np.float64] = (clipped + 1) * ((self._maximum - self._minimum) / 2)
        return self._minimum + scaled

    def check(self) -> None:
        """Runs an episode of random actions; one that is not as in `Task` is a RequestError."""
        random = np.random.default_rng(0)
        try:
            with self.worlds(1) as worlds:
                worlds.reset([random])
                for _ in range(EPISODE_STEPS):
                    worlds.step(random.uniform(-1, 1, (1, self.action_size)))
        except WorkError as error:
            raise RequestError(str(error)) from None
        except Exception as error:
            raise self._refusal(f"it fails ({sentence_of_failure(error)})") from error

    def _read_bounds(self, environment: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        spec = environment.action_spec()
        shape: tuple[int, ...] = getattr(spec, "shape", ())
        dtype = np.dtype(getattr(spec, "dtype", object))
        if len(shape) != 1 or not shape[0] or not np.issubdtype(dtype, np.floating):
            raise self._refusal(
                f"its actions are {dtype} of shape {shape}; jbench takes a vector of real numbers"
            )
        bounds = [getattr(spec, "minimum", -np.inf), getattr(spec, "maximum", np.inf)]
        minimum, maximum = (np.full(shape, bound, np.float64) for bound in bounds)
        bounded = (np.abs([minimum, maximum]) < _UNBOUNDED).all(axis=0) & (minimum < maximum)
        if not bounded.all():
            i = int(np.argmin(bounded))
            raise self._refusal(
                f"its action {i} is in [{minimum[i]:g}, {maximum[i]:g}]; give it two different "
                "finite bounds, which jbench scales to [-1, 1]"
            )
        return minimum, maximum

    def _refusal(self, reason: str) -> RequestError:
        return RequestError(f"jbench can't use the task {self.name}: {reason}.")


class DmWorlds(Worlds):
    """Environments of one task, stepped one after another."""

    def __init__(self, task: DmTask, count: int) -> None:
        self._task, self._steps = task, 0
        self.environments = [task.environment(0) for _ in range(count)]
        self._seeds = np.zeros(count, np.int64)
        self._observations = np.zeros((count, task.observation_size), np.float32)

    def close(self) -> None:
        """Closes the environments."""
        for environment in self.environments:
            _close(environment)

    def reset(self, generators: Sequence[Generator]) -> NDArray[np.float32]:
        """Begins an episode in each world with a seed of 32 bits from its generator."""
        return self._begin(range(len(generators)), [int(g.integers(2**32)) for g in generators])

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Applies actions; what is not as in `Task` and `Worlds` is a WorkError."""
        self._steps += 1
        rewards = np.empty(len(self.environments))
        observations = np.empty_like(self._observations)
        commands = self._task.commands(actions)
        for i, environment in enumerate(self.environments):
            timestep = environment.step(commands[i])
            reward = rewards[i] = np.nan if timestep.reward is None else timestep.reward
            if not -_ROUNDING <= reward <= 1 + _ROUNDING:
                raise self._failure(f"its reward is {reward}, not in [0, 1]")
            if timestep.last() and self._steps < EPISODE_STEPS:
                raise self._failure(
                    f"its episode ends, but must last {EPISODE_STEPS} control steps: give it "
                    "that time limit, and no other end"
                )
            self._observe(observations[i], timestep.observation)
        self._observations = observations
        return observations, rewards

    def state(self, rows: slice) -> WorldsState:
        """Returns the seeds of the episodes of some worlds, before their first step."""
        if self._steps:
            raise WorkError(f"{self._task.name} has a state between two episodes only.")
        return {"seeds": self._seeds[rows].copy()}

    def restore(self, rows: slice, state: WorldsState) -> NDArray[np.float32]:
        """Begins the episodes of `state` again in some worlds; returns all observations."""
        worlds = range(rows.start, rows.stop)
        return self._begin(worlds, np.asarray(state["seeds"]).tolist())

    def _begin(self, worlds: Sequence[int], seeds: Sequence[int]) -> NDArray[np.float32]:
        self._steps = 0
        self._observations = self._observations.copy()
        for world, seed in zip(worlds, seeds, strict=True):
            self._seeds[world] = seed
            if self._task.reseeds:
                self.environments[world].task.random.seed(seed)
            else:
                _close(self.environments[world])
                self.environments[world] = self._task.environment(seed)
            timestep = self.environments[world].reset()
            self._observe(self._observations[world], timestep.observation)
        return self._observations

    def _observe(self, row: NDArray[np.float32], values: Mapping[str, Any]) -> None:
        """Writes the parts of an observation, flattened in C order, into a row (size,)."""
        lacking = [name for name in self._task.parts if name not in values]
        if lacking:
            raise self._failure(f"its observation lacks {lacking[0]}")
        parts = [np.ravel(values[name]) for name in self._task.parts]
        if (size := sum(map(len, parts))) != len(row):
            raise self._failure(f"its observation has {size} values instead of {len(row)}")
        np.concatenate(parts, out=row, casting="same_kind")
        if not np.isfinite(row).all():
            name = next(n for n, value in values.items() if not np.isfinite(value).all())
            raise self._failure(f"{name} of its observation is not finite")

    def _failure(self, reason: str) -> WorkError:
        return WorkError(
            f"jbench can't use the task {self._task.name}: at control step {self._steps}, {reason}."
        )


def _close(environment: Any) -> None:
    if callable(close := getattr(environment, "close", None)):
        close()


def _model_hash(environment: Any) -> str | None:
    """Returns the SHA-256 of the physical parameters of an environment's MuJoCo model, if any.

    They are rounded to six digits, so that other versions of MuJoCo compile the same model.
    """
    model = getattr(getattr(environment, "physics", None), "model", None)
    if model is None:
        return None
    digest = hashlib.sha256()
    for holder, names in ((model, _PHYSICAL.split()), (model.opt, _OPTIONS)):
        for name in names:
            values = np.atleast_1d(np.asarray(getattr(holder, name), np.float64)) + 0.0
            text = " ".join(f"{value:.6g}" for value in values.ravel())
            digest.update(f"{name} {values.shape} {text}\n".encode())
    return digest.hexdigest()
