"""From what a user asks for to the settings of the runs."""

from collections.abc import Sequence
from typing import Any

from jbench.agents.ofe import requested_ofe, without_ofe
from jbench.agents.settings import algorithm_settings, parse_overrides
from jbench.encoders import find_encoder, load_encoder
from jbench.errors import RequestError
from jbench.names import EPISODE_STEPS, FULL, Base, Engine, Precision, TimeLimit
from jbench.store import Results
from jbench.training.settings import RunSettings
from jbench.validation import validated


def request_runs(
    results: Results,
    *,
    algo: str,
    task: str,
    encoder: str,
    seeds: list[int],
    steps: int,
    base: Base,
    overrides: list[str],
    time_limit: TimeLimit,
    evaluate_every: int,
    evaluate_episodes: int,
    augment: int | None = None,
    robots: int = 1,
    engine: Engine = "batched",
    precision: Precision = "float32",
    parallel: int | None = None,
) -> list[RunSettings]:
    """Returns the settings of one run for each seed.

    Args:
        results: where the encoder is.
        algo: one of `jbench.names.ALGORITHMS`.
        task: one of `jbench.names.TASKS`.
        encoder: "none", "ofeN" for N features that are learned with the agent, a number of
            latents, or an encoder's id.
        seeds: one for each run.
        steps: control steps of a run, over all its environments.
        base: "published", "script" or "sb3"; see `algorithm_settings`.
        overrides: texts NAME=VALUE that replace single settings, ofe.NAME=VALUE those of ofeN.
        time_limit: one of `jbench.names.TIME_LIMITS`.
        evaluate_every: control steps between evaluations.
        evaluate_episodes: episodes in an evaluation.
        augment: seed of the augmented robot; None for the plain one.
        robots: augmented robots, one after the other, the first of seed `augment` or else 0.
        engine: what trains them.
        precision: of the batched engine's products.
        parallel: environments of each seed; None for the algorithm's own.

    Raises:
        RequestError: if there is no such encoder, setting or robot, no episode could end, or the
            robots don't divide the steps into whole episodes.
    """
    of_algorithm, of_features = without_ofe(parse_overrides(overrides))
    algorithm = algorithm_settings(algo, base, of_algorithm)
    ofe = requested_ofe(encoder, of_features)
    representation, encoder_id = FULL, None
    if ofe is not None:
        representation = ofe.representation
    elif of_features:
        raise RequestError(
            "--set ofe.NAME=VALUE is for --encoder ofeN, such as ofe12; leave it out."
        )
    elif encoder != "none":
        encoder_id = find_encoder(results, encoder, task)
        _, description = load_encoder(results, encoder_id)
        representation = f"{description['kind']}{description['latents']}"
    shared: dict[str, Any] = {
        "task": task,
        "algo": algo,
        "representation": representation,
        "encoder": encoder_id,
        "ofe": ofe,
        "steps": steps,
        "time_limit": time_limit,
        "evaluate_every": evaluate_every,
        "evaluate_episodes": evaluate_episodes,
        "hyperparameters": algorithm.model_dump(mode="json"),
        "augment": augment,
        "robots": robots,
        "engine": engine,
        "precision": precision,
        "parallel": parallel,
    }
    return runs_of(seeds, **shared)


def runs_of(seeds: Sequence[int], **shared: Any) -> list[RunSettings]:
    """Returns the settings of one run for each seed.

    Args:
        seeds: one for each run.
        shared: the other fields of `RunSettings`.

    Raises:
        RequestError: if a value can't be, or no episode could end.
    """
    runs = [validated(RunSettings, "the run", seed=seed, **shared) for seed in seeds]
    least, steps = EPISODE_STEPS * runs[0].environments, runs[0].steps
    if steps < least:
        raise RequestError(
            f"--steps {steps}: no episode would end, since {runs[0].environments} environments of "
            f"{EPISODE_STEPS} control steps go on at a time; type --steps {least} or more."
        )
    return runs


def find_device(engine: Engine, wanted: str, precision: Precision = "float32") -> str:
    """Returns the device to learn on, `cpu` or `cuda`.

    Args:
        engine: that trains.
        wanted: one of `jbench.names.DEVICES`.
        precision: of its products.

    Raises:
        RequestError: if it is not there, or not for this engine or precision.
    """
    if engine == "sb3":
        if wanted == "cuda":
            raise RequestError("--device cuda is for --engine batched; stable-baselines3 gets cpu.")
        return "cpu"
    from jbench.agents.batched.make import device_of

    found = device_of(wanted).type
    if precision == "tf32" and found == "cpu":
        raise RequestError("Only a GPU has --precision tf32; type float32 or bfloat16.")
    return found
