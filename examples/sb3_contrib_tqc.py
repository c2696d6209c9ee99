"""TQC of sb3-contrib (Kuznetsov et al., 2020), recorded as a run of jbench.

The lines marked "jbench" are all that differs from the same script without jbench.

    pip install "jbench[examples]"
    python examples/sb3_contrib_tqc.py --seed 1
"""

import argparse

from sb3_contrib import TQC

import jbench  # jbench


def main() -> None:
    """Trains an agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--total-timesteps", type=int, default=100_000)
    parser.add_argument("--learning-starts", type=int, default=10_000)
    parser.add_argument("--hidden", type=int, default=256)
    args = parser.parse_args()
    with jbench.record(  # jbench
        "face_direction",
        algo="tqc",
        seed=args.seed,
        steps=args.total_timesteps,
        hyperparameters=vars(args),
    ) as recording:
        model = TQC(
            "MlpPolicy",
            recording.env(),  # jbench
            seed=args.seed,
            learning_starts=args.learning_starts,
            policy_kwargs={"net_arch": [args.hidden, args.hidden]},
        )
        model.learn(args.total_timesteps, callback=recording.sb3_callback())  # jbench


if __name__ == "__main__":
    main()
