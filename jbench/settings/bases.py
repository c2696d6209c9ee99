"""Sources of hyperparameters: in what each differs from the defaults of the settings classes.

The defaults in `jbench.settings.algorithms` are the published ones.
"""

from typing import Any

from jbench.names import Base

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
    "td3": {
        "initialization": "glorot",
        "learning_starts": 9_999,  # the first update is at step 10,000, not one episode later
    },
}

_EVERY_STEP = {"uniform_warmup": True, "train_freq": 1, "gradient_steps": 1, "tau": 0.005}
_PPO = {"n_epochs": 10, "clip_range_vf": None}
_SAC = {"target_entropy": "auto"}  # minus the number of actions
_SUITE = {**_EVERY_STEP, "hidden_layers": [256, 256], "learning_starts": 1_000, "noise_mean": 0.0}

CHANGES: dict[Base, dict[str, dict[str, Any]]] = {
    "published": {},
    "script": SCRIPT,
    # Defaults of stable-baselines3 2.9 that differ and are not in Table 1.
    "sb3": {
        "ddpg": {**_EVERY_STEP, "learning_starts": 100},
        "ppo": {**_PPO, "batch_size": 256},  # Table 1's
        "sac": _SAC,
        "td3": {},
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
