"""When a run is evaluated, and in how many episodes, unless a user says it."""

EVALUATION_EPISODES = 10
"""Episodes of an evaluation, unless others are typed or the run is short."""

SHORT_RUN = 200
"""Episodes of training from which on ten evaluations of ten episodes, and a last one of a hundred,
take no longer than the training."""


def evaluation_interval(steps: int, episode_steps: int) -> int:
    """Returns the control steps between evaluations: a tenth of a run in whole episodes.

    They are at most 50,000, also where that is within an episode.
    """
    return min(max(steps // (10 * episode_steps), 1) * episode_steps, 50_000)


def evaluation_schedule(
    steps: int, episode_steps: int, every: int | None = None, episodes: int | None = None
) -> tuple[int, int]:
    """Returns the control steps between evaluations and the episodes of each, as typed if they are.

    If neither is typed, all evaluations of a short run take at most as long as its training: see
    `SHORT_RUN`.
    """
    if every is None and episodes is None and steps < SHORT_RUN * episode_steps:
        return _short_evaluations(steps, episode_steps)
    if every is None:
        every = evaluation_interval(steps, episode_steps)
    if episodes is None:
        episodes = EVALUATION_EPISODES
    return every, episodes


def has_short_evaluations(steps: int, episode_steps: int, every: int, episodes: int) -> bool:
    """Returns whether evaluations are those of a short run whose user typed none."""
    is_short = steps < SHORT_RUN * episode_steps
    return is_short and (every, episodes) == _short_evaluations(steps, episode_steps)


def _short_evaluations(steps: int, episode_steps: int) -> tuple[int, int]:
    """Returns about ten evaluations with half as many episodes as the run has.

    The last evaluation has the other half.
    """
    trained = steps // episode_steps
    between = max(trained // 10, min(2, trained), 1)
    return between * episode_steps, max(trained // 20, 1)
