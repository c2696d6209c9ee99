"""Hyperparameters of the four algorithms, with stable-baselines3's names.

The defaults of the classes are the published settings. "Table 1" is the paper's; where it gives no
value, the paper used the defaults of stable-baselines 2 (section 5, Table 1), which differ from
those of stable-baselines3. "Script" is the authors' training script, which runs stable-baselines 2
and differs from Table 1; `docs/agents.md` lists the differences.
"""

from typing import Any, Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt, model_validator

from jbench.errors import RequestError
from jbench.names import TASKS, Base, TimeLimit
from jbench.settings.base import Count, omissible, settings_with
from jbench.settings.inputs import InputSettings

Initialization = Literal["fan-in", "glorot"]
Noise = Literal["none", "normal", "ornstein-uhlenbeck"]


class AlgorithmSettings(InputSettings):
    """Settings of all four algorithms. Only the batched engine supports omissible settings."""

    learning_rate: float = Field(1e-4, gt=0, description="of Adam; Table 1")
    batch_size: Count = Field(256, description="transitions; Table 1")
    gamma: float = Field(0.99, ge=0, le=1, description="discount; section 4.2")
    hidden_layers: tuple[Count, ...] = Field(
        (350, 250),
        strict=False,  # JSON has lists
        description="ReLU units of each hidden layer, in actor and critic; Table 1",
    )

    def rollout_steps(self, environments: int) -> int:
        """Returns the control steps of each environment between learning phases."""
        raise NotImplementedError


class OffPolicySettings(AlgorithmSettings):
    """Settings of DDPG, TD3, SAC and rules of other packages, whose defaults these are."""

    buffer_size: Count = Field(1_000_000, description="transitions; Table 1")
    learning_starts: NonNegativeInt = Field(100, description="control steps until the first update")
    uniform_warmup: bool = Field(True, description="uniform actions before learning_starts")
    train_freq: Count = Field(1, description="control steps between updates; stable-baselines 2")
    gradient_steps: Count = Field(1, description="updates per train_freq steps; stable-baselines 2")
    tau: float = Field(0.005, gt=0, le=1, description="of the target networks; stable-baselines 2")
    action_noise: Noise = Field("none", description="for exploration")
    noise_mean: float = Field(0.0, description="of the action noise; Table 1")
    noise_sigma: float = Field(0.2, ge=0, description="of the action noise; Table 1")
    noise_theta: float = Field(0.15, ge=0, description="Ornstein-Uhlenbeck; Table 1")
    noise_dt: float = Field(0.01, gt=0, description="s; stable-baselines 2")
    mirror: bool = omissible(
        False,
        description="whether half of each minibatch is mirrored: x to -x, the action negated; ours",
    )

    @property
    def first_update(self) -> int:
        """Control steps before the first update, with one environment."""
        return self.train_freq * (self.learning_starts // self.train_freq + 1)

    def rollout_steps(self, environments: int) -> int:
        """Returns the control steps of each environment between learning phases."""
        return max(1, self.train_freq // environments)

    def schedule(self, environments: int) -> tuple[int, int]:
        """Returns the steps per environment between learning phases, and the updates per phase.

        More environments take fewer steps each, so the ratio of updates to control steps does not
        depend on their number. Raises a RequestError if the number of updates is not an integer.
        """
        steps = self.rollout_steps(environments)
        updates, remainder = divmod(self.gradient_steps * steps * environments, self.train_freq)
        if remainder:
            raise RequestError(
                f"{environments} environments can't share {self.gradient_steps} updates every "
                f"{self.train_freq} control steps: type a number of environments that divides "
                f"{self.train_freq}."
            )
        return steps, updates


class DeterministicSettings(OffPolicySettings):
    """Settings of DDPG and TD3, whose policies are deterministic."""

    initialization: Initialization = omissible(
        "fan-in",
        description="first weights: U(-b, b) with b = 1 / sqrt(inputs), for biases too, as in "
        "stable-baselines3; or b = sqrt(6 / (inputs + outputs)) and zero biases, as in the script",
    )


class DDPGSettings(DeterministicSettings):
    """DDPG (Lillicrap et al., 2015)."""

    # Updates begin as soon as a batch can be sampled; the policy acts from the first step.
    learning_starts: NonNegativeInt = Field(256, description="stable-baselines 2")
    uniform_warmup: bool = Field(False, description="stable-baselines 2")
    train_freq: Count = Field(100, description="stable-baselines 2")
    gradient_steps: Count = Field(50, description="stable-baselines 2")
    tau: float = Field(0.001, gt=0, le=1, description="stable-baselines 2")
    action_noise: Noise = "ornstein-uhlenbeck"
    noise_mean: float = 0.3
    noise_sigma: float = Field(0.3, ge=0)
    action_layer: Literal[0, 1] = omissible(
        0, description="layer of the critic that takes the action: 0, the first; script: 1"
    )
    last_layer_bound: float | None = omissible(
        None,
        gt=0,
        description="both output layers are initialized from U(-bound, bound); script: 0.003; "
        "None: like the other layers",
    )
    gradients_first: bool = omissible(
        False, description="whether both gradients are computed before either step; script: true"
    )

    @model_validator(mode="after")
    def _layer_exists(self) -> Self:
        if self.action_layer > len(self.hidden_layers):
            raise ValueError("action_layer=1 needs a critic with hidden layers")
        return self


class TD3Settings(DeterministicSettings):
    """TD3 (Fujimoto et al., 2018)."""

    learning_starts: NonNegativeInt = Field(10_000, description="Table 1")
    train_freq: Count = Field(1000, description="Table 1")
    gradient_steps: Count = Field(1000, description="Table 1")
    action_noise: Noise = "normal"
    policy_delay: Count = Field(2, description="stable-baselines 2")
    target_policy_noise: float = Field(0.2, ge=0, description="stable-baselines 2")
    target_noise_clip: float = Field(0.5, ge=0, description="stable-baselines 2")


class SACSettings(OffPolicySettings):
    """SAC with a learned entropy coefficient (Haarnoja et al., 2018)."""

    action_noise: Noise = "normal"
    ent_coef: NonNegativeFloat | Literal["auto"] = Field("auto", description="stable-baselines 2")
    target_entropy: float | Literal["auto"] = Field(
        -1.0, description="minus the number of actions; stable-baselines 2"
    )
    target_update_interval: Count = Field(1, description="stable-baselines 2")


class PPOSettings(AlgorithmSettings):
    """PPO with a clipped objective (Schulman et al., 2017)."""

    n_envs: Count = Field(8, description="parallel environments; authors' script")
    n_steps: Count = Field(256, description="per environment and update; Table 1")
    normalize_clip: float = omissible(
        10.0, gt=0, description="bound of a standardized number; stable-baselines3"
    )
    # stable-baselines 2 has no batch size for PPO but 4 minibatches: 8 * 256 / 4 transitions.
    batch_size: Count = Field(512, description="stable-baselines 2")
    n_epochs: Count = Field(4, description="stable-baselines 2")
    gae_lambda: float = Field(0.95, ge=0, le=1, description="stable-baselines 2")
    clip_range: float = Field(0.2, gt=0, description="stable-baselines 2 (script: 0.1)")
    clip_range_vf: float | None = Field(0.2, gt=0, description="as clip_range; stable-baselines 2")
    normalize_advantage: bool = Field(True, description="stable-baselines 2")
    ent_coef: float = Field(0.01, ge=0, description="Table 1")
    vf_coef: float = Field(0.5, ge=0, description="stable-baselines 2 (script: 0.25)")
    max_grad_norm: float = Field(0.5, gt=0, description="stable-baselines 2")
    shared_layers: bool = omissible(
        False, description="whether policy and value share their hidden layers; script: true"
    )
    value_loss: Literal["clipped", "max"] = omissible(
        "clipped",
        description="squared error of the clipped value, or the maximum of those of the clipped "
        "and the unclipped; script: max",
    )

    def rollout_steps(self, environments: int) -> int:
        """Returns the control steps of each environment between updates, `n_steps` if `n_envs`."""
        return max(1, self.n_steps * self.n_envs // environments)


SETTINGS: dict[str, type[AlgorithmSettings]] = {
    "ddpg": DDPGSettings,
    "ppo": PPOSettings,
    "sac": SACSettings,
    "td3": TD3Settings,
}

ALGORITHMS = tuple(SETTINGS)
"""The four algorithms of the paper (section 5.1 and Figure 9)."""

SCRIPT: dict[str, dict[str, Any]] = {
    "ddpg": {
        **{"initialization": "glorot", "action_layer": 1},
        **{"last_layer_bound": 3e-3, "gradients_first": True},
    },
    "ppo": {
        "n_steps": 32,  # 256 over 8 environments
        "batch_size": 64,  # 4 minibatches
        **{"clip_range": 0.1, "clip_range_vf": 0.1, "value_loss": "max", "shared_layers": True},
        "vf_coef": 0.25,  # stable-baselines 2: 0.5 of half the squared error
    },
    # The first update is at step 10,000, not one episode later.
    "td3": {"initialization": "glorot", "learning_starts": 9_999},
}

FIGURE8: dict[str, dict[str, Any]] = {
    "ddpg": {
        **SCRIPT["ddpg"],
        "hidden_layers": [300, 300, 300],
        "batch_size": 64,
        "learning_starts": 64,  # a minibatch, so that the first update is at control step 100
        "normalize": "running",
        "normalize_min_sd": 0.1,
        "normalize_epsilon": 0.0,
        "normalize_start_count": 0.01,
    },
}

_EVERY_STEP = {"uniform_warmup": True, "train_freq": 1, "gradient_steps": 1, "tau": 0.005}
_PPO = {"n_epochs": 10, "clip_range_vf": None}
_SAC = {"target_entropy": "auto"}  # minus the number of actions
_SUITE = {**_EVERY_STEP, "hidden_layers": [256, 256], "learning_starts": 1_000, "noise_mean": 0.0}

CHANGES: dict[Base, dict[str, dict[str, Any]]] = {
    "published": {},
    "script": SCRIPT,
    # An earlier script of the authors, whose agents Figures 7 and 8 show.
    "figure8": FIGURE8,
    # Defaults of stable-baselines3 2.9 that differ and are not in Table 1.
    "sb3": {
        "ddpg": {**_EVERY_STEP, "learning_starts": 100},
        "ppo": {**_PPO, "batch_size": 256},  # Table 1's
        "sac": _SAC,
    },
    # Other robots: stable-baselines3's defaults, but off policy with two layers of 256 units and
    # 1,000 random steps.
    "suite": {
        "ddpg": {**_SUITE, "learning_rate": 1e-3, "action_noise": "normal", "noise_sigma": 0.1},
        "ppo": {
            **{**_PPO, "hidden_layers": [64, 64], "batch_size": 64},
            **{"learning_rate": 3e-4, "ent_coef": 0.0},
        },
        "sac": {**_SUITE, **_SAC, "learning_rate": 3e-4, "action_noise": "none"},
        "td3": {**_SUITE, "learning_rate": 1e-3, "noise_sigma": 0.1},
    },
}
"""Sources of hyperparameters: in what each differs from the published ones, by algorithm."""


TIME_LIMITS: dict[Base, TimeLimit] = {"figure8": "terminal"}
"""Sources of hyperparameters that also say what the time limit is, unless it is typed."""


def default_time_limit(base: Base | None) -> TimeLimit:
    """Returns what the time limit of an episode is if no other one is typed."""
    return "bootstrap" if base is None else TIME_LIMITS.get(base, "bootstrap")


def default_base(task: str, base: Base | None = None) -> Base:
    """Returns the base as typed; of None, the task's: published for the Jitterbug, else suite."""
    return base or ("published" if task in TASKS else "suite")


def algorithm_settings(
    algo: str, base: Base = "published", overrides: dict[str, Any] | None = None
) -> AlgorithmSettings:
    """Returns the settings of one of `ALGORITHMS`, with some values by name instead.

    Raises a RequestError if a setting is unknown, its value is invalid, or the base has no such
    algorithm.
    """
    kind = SETTINGS[algo]
    if base == "script" and algo not in SCRIPT:
        raise RequestError(
            f"The settings of the script are for {', '.join(SCRIPT)}: the script's {algo} is "
            "another algorithm, with a state-value network; choose published."
        )
    if base == "figure8" and algo not in FIGURE8:
        raise RequestError(
            f"The settings figure8 are for {', '.join(FIGURE8)}, whose agents Figure 8 shows, not "
            f"for {algo}; choose published, and --set normalize=running for standardized inputs."
        )
    return settings_with(kind, algo, CHANGES[base].get(algo, {}) | (overrides or {}))
