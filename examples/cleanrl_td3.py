"""TD3 (Fujimoto et al., 2018) in one file, recorded as a run of jbench.

The lines marked "jbench" are all that differs from the same script without jbench.

    python examples/cleanrl_td3.py --seed 1
"""

import argparse
import copy

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.nn import functional

import jbench  # jbench

DEFAULTS = {
    "seed": 1,
    "total_timesteps": 100_000,
    "learning_starts": 10_000,
    "batch_size": 256,
    "hidden": 256,
    "learning_rate": 3e-4,
    "gamma": 0.99,
    "tau": 0.005,
    "exploration_noise": 0.1,
    "policy_noise": 0.2,
    "noise_clip": 0.5,
    "policy_delay": 2,
}


def parse_arguments() -> argparse.Namespace:
    """Returns the settings of the run."""
    parser = argparse.ArgumentParser()
    for name, default in DEFAULTS.items():
        parser.add_argument(f"--{name.replace('_', '-')}", type=type(default), default=default)
    return parser.parse_args()


class Actor(nn.Module):
    """Deterministic policy."""

    def __init__(self, observation_size: int, hidden: int) -> None:
        super().__init__()
        self.fc1 = nn.Linear(observation_size, hidden)
        self.fc2 = nn.Linear(hidden, hidden)
        self.fc_mu = nn.Linear(hidden, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Returns actions (n, 1)."""
        x = functional.relu(self.fc1(x))
        return torch.tanh(self.fc_mu(functional.relu(self.fc2(x))))


def make_critic(observation_size: int, hidden: int) -> nn.Sequential:
    """Returns an action-value network."""
    first, second = nn.Linear(observation_size + 1, hidden), nn.Linear(hidden, hidden)
    return nn.Sequential(first, nn.ReLU(), second, nn.ReLU(), nn.Linear(hidden, 1))


def main() -> None:
    """Trains an agent."""
    args = parse_arguments()
    torch.manual_seed(args.seed)
    rng = np.random.default_rng(args.seed)
    with jbench.record(  # jbench
        "face_direction",
        algo="cleanrl-td3",
        seed=args.seed,
        steps=args.total_timesteps,
        hyperparameters=vars(args),
    ) as recording:
        same_step = gym.vector.AutoresetMode.SAME_STEP
        envs = gym.vector.SyncVectorEnv([recording.env], autoreset_mode=same_step)  # jbench
        size = envs.single_observation_space.shape[0]
        actor = Actor(size, args.hidden)
        critics = nn.ModuleList([make_critic(size, args.hidden) for _ in range(2)])
        target_actor, target_critics = copy.deepcopy(actor), copy.deepcopy(critics)
        actor_optimizer = torch.optim.Adam(actor.parameters(), lr=args.learning_rate)
        critic_optimizer = torch.optim.Adam(critics.parameters(), lr=args.learning_rate)
        # Columns: observation, action, reward, termination, next observation.
        buffer = np.zeros((args.total_timesteps, 2 * size + 3), np.float32)

        observations, _ = envs.reset(seed=args.seed)
        for step in range(args.total_timesteps):
            if step < args.learning_starts:
                actions = rng.uniform(-1, 1, (1, 1)).astype(np.float32)
            else:
                with torch.no_grad():
                    actions = actor(torch.as_tensor(observations)).numpy()
                noise = rng.normal(0, args.exploration_noise, actions.shape)
                actions = np.clip(actions + noise, -1, 1).astype(np.float32)
            following, rewards, terminations, _, infos = envs.step(actions)
            last = infos["final_obs"][0] if "final_obs" in infos else following[0]
            transition = observations[0], actions[0], rewards, terminations, last
            buffer[step] = np.concatenate(transition)
            observations = following
            recording.evaluate(actor)  # jbench
            if step < args.learning_starts:
                continue

            batch = torch.from_numpy(buffer[rng.integers(0, step + 1, args.batch_size)])
            s, a, r, end, s2 = batch.split([size, 1, 1, 1, size], dim=1)
            with torch.no_grad():
                noise = (torch.randn_like(a) * args.policy_noise).clamp(
                    -args.noise_clip, args.noise_clip
                )
                a2 = (target_actor(s2) + noise).clamp(-1, 1)
                next_value = torch.min(*(q(torch.cat([s2, a2], 1)) for q in target_critics))
                target = r + args.gamma * (1 - end) * next_value
            loss = sum(functional.mse_loss(q(torch.cat([s, a], 1)), target) for q in critics)
            critic_optimizer.zero_grad()
            loss.backward()
            critic_optimizer.step()
            if step % args.policy_delay == 0:
                actor_loss = -critics[0](torch.cat([s, actor(s)], 1)).mean()
                actor_optimizer.zero_grad()
                actor_loss.backward()
                actor_optimizer.step()
                with torch.no_grad():
                    for network, slow in ((actor, target_actor), (critics, target_critics)):
                        pairs = zip(network.parameters(), slow.parameters(), strict=True)
                        for parameter, average in pairs:
                            average.lerp_(parameter, args.tau)
        recording.keep_policy(actor)  # jbench


if __name__ == "__main__":
    main()
