"""Sources of hyperparameters: in what each differs from the defaults of the settings classes.

The defaults in `jbench.settings.algorithms` are the published ones.
"""

from typing import Any

from jbench.names import Base

SCRIPT: dict[str, dict[str, Any]] = {
    "ddpg": {
        "initialization": "glorot",
        "last_layer_bound": 3e-3,
        "action_layer": 1,
        "gradients_first": True,
    },
    "ppo": {
        "n_steps": 32,  # 256 over 8 environments
        "batch_size": 64,  # 4 minibatches
        "clip_range": 0.1,
        "clip_range_vf": 0.1,
        "value_loss": "max",
        "vf_coef": 0.25,  # stable-baselines 2: 0.5 of half the squared error
        "shared_layers": True,
    },
    "td3": {
        "initialization": "glorot",
        "learning_starts": 9_999,  # the first update is at step 10,000, not one episode later
    },
}

_OFF_POLICY = {
    "hidden_layers": [256, 256],
    "learning_starts": 1_000,
    "uniform_warmup": True,
    "train_freq": 1,
    "gradient_steps": 1,
    "tau": 0.005,
    "noise_mean": 0.0,
}

CHANGES: dict[Base, dict[str, dict[str, Any]]] = {
    "published": {},
    "script": SCRIPT,
    # Defaults of stable-baselines3 2.9 that differ and are not in Table 1.
    "sb3": {
        "ddpg": {
            "learning_starts": 100,
            "uniform_warmup": True,
            "train_freq": 1,
            "gradient_steps": 1,
            "tau": 0.005,
        },
        "ppo": {"batch_size": 256, "n_epochs": 10, "clip_range_vf": None},  # the batch is Table 1's
        "sac": {"target_entropy": "auto"},
        "td3": {},
    },
    # Other robots: stable-baselines3's defaults, but off policy with two layers of 256 units and
    # 1,000 random steps.
    "suite": {
        "ddpg": {
            **_OFF_POLICY,
            "learning_rate": 1e-3,
            "action_noise": "normal",
            "noise_sigma": 0.1,
        },
        "ppo": {
            "hidden_layers": [64, 64],
            "learning_rate": 3e-4,
            "batch_size": 64,
            "n_epochs": 10,
            "clip_range_vf": None,
            "ent_coef": 0.0,
        },
        "sac": {
            **_OFF_POLICY,
            "learning_rate": 3e-4,
            "action_noise": "none",
            "target_entropy": "auto",  # minus the number of actions
        },
        "td3": {**_OFF_POLICY, "learning_rate": 1e-3, "noise_sigma": 0.1},
    },
}
