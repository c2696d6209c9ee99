"""What each training engine can do, for those who plan, evaluate and repeat its runs."""

from dataclasses import dataclass

from jbench.settings.records import EXTERNAL


@dataclass(frozen=True)
class EngineFacts:
    """What a training engine can do.

    Attributes:
        takes_many_seeds: whether runs that differ in their seeds can be trained in one process.
        has_options: whether it has the settings precision and ofe.
        has_replay_buffers: whether off-policy algorithms learn from jbench's replay buffers.
        is_for_gpu: whether it trains on a GPU, too.
        has_one_stream: whether all evaluations of a run draw from one generator, episode by
            episode; otherwise each has its own, and its episodes are stepped together.
        copies_round_alike: whether the kept policy acts as the agent that was evaluated, bit for
            bit, if the same code computes both.
        loads_policies: whether a kept policy can be loaded into it, and then acts with the bits of
            the agent that was evaluated.
        has_checkpoints: whether its runs can be resumed and continued, if the agent can.
        asks_agents_for_state: whether a checkpoint has what the agent itself returns as its state.
        trains_rules: whether the algorithms of other packages that it trains are update rules.
        is_stable_baselines3: whether stable-baselines3 makes its agents, and checks their settings.
    """

    takes_many_seeds: bool = False
    has_options: bool = False
    has_replay_buffers: bool = False
    is_for_gpu: bool = False
    has_one_stream: bool = False
    copies_round_alike: bool = True
    loads_policies: bool = False
    has_checkpoints: bool = True
    asks_agents_for_state: bool = False
    trains_rules: bool = False
    is_stable_baselines3: bool = False


ENGINES: dict[str, EngineFacts] = {
    "batched": EngineFacts(
        takes_many_seeds=True,
        has_options=True,
        has_replay_buffers=True,
        is_for_gpu=True,
        loads_policies=True,
        trains_rules=True,
    ),
    "sb3": EngineFacts(has_one_stream=True, has_checkpoints=False, is_stable_baselines3=True),
    # An agent computes its actions by its own code.
    "plugin": EngineFacts(is_for_gpu=True, copies_round_alike=False, asks_agents_for_state=True),
    EXTERNAL: EngineFacts(),
}
"""The training engines by name, and training loops of others that jbench records."""
