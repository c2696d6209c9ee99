"""The names that users type, without any import, so that help and completion stay instant."""

TASKS = (
    "move_from_origin",
    "face_direction",
    "move_in_direction",
    "move_to_position",
    "move_to_pose",
)
"""The five tasks in the paper's order of rising difficulty (paper, section 4.2)."""

ALGORITHMS = ("ddpg", "ppo", "sac", "td3")
"""The four algorithms of the paper (section 5.1 and Figure 9)."""

TIME_LIMITS = ("bootstrap", "terminal")
"""What an agent may learn from an episode's last step: see `docs/agents.md`."""

FULL = "full"
"""The representation of an agent that sees the whole observation, without an encoder."""

EPISODE_STEPS = 1000
"""Control steps in an episode, in every environment (paper, section 4.1)."""

CONTROL_TIMESTEP = 0.01
"""Seconds of simulated time in a control step (paper, section 4.1)."""

PHYSICS_STEPS = 50
"""Physics steps of 0.2 ms in a control step, the action held (paper, section 4.1)."""
