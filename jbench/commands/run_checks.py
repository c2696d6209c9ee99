"""What train and sweep check, and warn of, before they train runs."""

from collections.abc import Iterator, Sequence

from jbench.commands import output
from jbench.devices import slowdown_of_bfloat16
from jbench.names import KeepState
from jbench.settings.defaults import chosen
from jbench.settings.run import RunSettings
from jbench.tasks.find import find_task
from jbench.training.continuation import check_state_can_be_kept
from jbench.wording import in_matrix_file

_NOTABLE_SLOWDOWN = 1.1  # a smaller one may be noise


def check_runs(
    runs: Sequence[RunSettings],
    keep_state: KeepState,
    device: str | None,
    final_episodes: int | None = None,
) -> None:
    """Checks that runs, one of each configuration, can be kept.

    Warns of unexpected lengths, of hyperparameters and of episodes of the last evaluation that have
    no effect, and of a precision that this machine's device, such as cpu, is slow in; the device is
    None if other machines train.
    """
    if keep_state != "no":
        check_state_can_be_kept(runs, keep_state)

    if device == "cpu" and any(run.precision == "bfloat16" for run in runs):
        _warn_of_slow_bfloat16()

    sentences = list[str]()
    if final_episodes is not None and not any(run.evaluate_episodes for run in runs):
        sentences.append(
            "--final-episodes has no effect without evaluations; type --evaluate-episodes 1 or "
            f"more {in_matrix_file('the key episodes', 'evaluation')}."
        )
    for run in runs:
        output.note_task(find_task(run.task))
        sentences += _without_effect(run)

    for run in (run for run in runs if run.algorithm.knows_rollouts):
        end = run.last_step
        episode = run.episode_steps
        if run.steps % episode and not find_task(run.task).ends_early:
            where = f"in the middle of an episode of {episode:,}, whose return is not recorded"
            if end % (episode * run.environments) == 0:
                where = f"at the end of an episode of {episode:,}"
            sentences.append(f"a run of {run.steps:,} control steps ends after {end:,}, {where}.")

        first = run.first_update
        if end < first or (end == first and _ends_with_evaluation(run)):
            keys = in_matrix_file("the same keys", f"hyperparameters.{run.algo}")
            sentences.append(
                f"{run.algo} first updates its networks after {first:,} control "
                f"steps, so a run of {run.steps:,} learns nothing; raise --steps, or lower that "
                f"number with --set learning_starts=N and --set train_freq=N {keys}."
            )

    for sentence in dict.fromkeys(sentences):
        output.warn(sentence)


def _without_effect(run: RunSettings) -> Iterator[str]:
    """Yields a sentence for each hyperparameter that was chosen and changes nothing."""
    needed = run.algorithm.without_effect()
    for name in chosen(run).hyperparameters:
        if name in needed:
            yield f"{name} of {run.algo} has no effect without {needed[name]}."


def _ends_with_evaluation(run: RunSettings) -> bool:
    """Returns whether an evaluation is due at the last control step, before its updates.

    That is, whether a multiple of `evaluate_every` was passed since the control step before.
    """
    return run.last_step % run.evaluate_every < run.environments


def _warn_of_slow_bfloat16() -> None:
    """Warns of a processor that multiplies in bfloat16 more slowly than in float32."""
    slowdown = slowdown_of_bfloat16()
    if slowdown >= _NOTABLE_SLOWDOWN:
        output.warn(
            f"this processor multiplies in bfloat16 {slowdown:.1f} times as slowly as in float32; "
            f"leave --precision out {in_matrix_file('the key precision')}."
        )
