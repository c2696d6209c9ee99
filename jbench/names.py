"""The names that users type, without heavy imports, so that help and completion stay instant."""

import difflib
from collections.abc import Iterable, Sequence
from typing import Literal, TypeVar, get_args

from jbench.errors import RequestError

_Name = TypeVar("_Name", bound=str)

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

ENCODER_KINDS = {
    "dae": "jbench.encoders.kinds.dae:DenoisingAutoencoder",
    "ae": "jbench.encoders.kinds.ae:Autoencoder",
    "ddae": "jbench.encoders.kinds.ddae:DynamicDenoisingAutoencoder",
    "vae": "jbench.encoders.kinds.vae:VariationalAutoencoder",
    "lld-vae": "jbench.encoders.kinds.lld_vae:LocallyLinearVariationalAutoencoder",
    "pca": "jbench.encoders.kinds.pca:PrincipalComponents",
    "random": "jbench.encoders.kinds.random_projection:RandomProjection",
    "scaled": "jbench.encoders.kinds.scaled:Scaled",
    "planar": "jbench.encoders.kinds.planar:PlanarReduction",
    "forward": "jbench.encoders.kinds.forward:ForwardModel",
    "dmd": "jbench.encoders.kinds.dmd:DynamicModes",
    "contrastive": "jbench.encoders.kinds.contrastive:Contrastive",
    "random-features": "jbench.encoders.kinds.random_features:RandomFeatures",
}
"""Our kinds of encoders, and where their classes are; other packages may offer more."""

DEVICES = ("auto", "cpu", "cuda")
"""Where to compute; auto is cuda where there is one."""

CAMERAS = ("overhead", "tracking", "ego", "spectator")
"""The cameras of the model: the paper's three (section 4.1) and a fixed view from the side."""

TimeLimit = Literal["bootstrap", "terminal"]
TIME_LIMITS: tuple[TimeLimit, ...] = get_args(TimeLimit)
"""Whether the value of an episode's last state is bootstrapped, or nothing as after an end."""

Engine = Literal["batched", "sb3"]
ENGINES: tuple[Engine, ...] = get_args(Engine)
"""What trains agents: ours, many seeds at a time, or stable-baselines3, one by one."""

Precision = Literal["float32", "tf32", "bfloat16"]
PRECISIONS: tuple[Precision, ...] = get_args(Precision)
"""Of the batched engine's products; what is kept is float32 in any case."""

Base = Literal["published", "script", "sb3"]
BASES: tuple[Base, ...] = get_args(Base)
"""Whose settings apply: Table 1 with the paper's library or with stable-baselines3 where the table
is silent, or those of the authors' script, which differs from Table 1."""

Order = Literal["quantile-first", "smooth-first"]
ORDERS: tuple[Order, ...] = get_args(Order)
"""Whether quantiles across seeds come before the moving average (Figure 9) or after (Figure 8)."""

ReturnsName = Literal["evaluation", "training"]
RETURNS: tuple[ReturnsName, ...] = get_args(ReturnsName)
"""The returns that a run records: of its deterministic policy, and of its training episodes."""

SWEEPS = ("smoke", "fig7", "fig8", "fig9", "question")
"""The matrices of runs that are shipped: a small one, those of the paper's figures, and those that
answer whether learning on a reduced order helps."""

EXECUTORS = ("local", "ray")
"""Where the runs of a sweep go on: on this machine, or on a Ray cluster."""

FIGURE_FORMATS = ("png", "svg", "pdf")
"""Endings of the files of figures."""

REFERENCE = "reference"
"""What `--results` calls the results shipped with jbench."""

FULL = "full"
"""The representation of an agent that sees the whole observation, without an encoder."""

OFE = "ofe"
"""The representation of an agent with features that are learned with it, a number behind it."""


def kind_of(representation: str) -> str:
    """Returns the kind of a representation: `scaled` of scaled16, `full` of full."""
    return representation.rstrip("0123456789")


LARGEST_SEED = 2**63 - 1
"""Seeds are kept in the database as signed numbers of 64 bits."""

CHECKPOINT_EVERY = 60.0
"""Least time between two checkpoints of a run (s); a kill loses this, and up to an episode more."""

EPISODE_STEPS = 1000
"""Control steps in an episode, in every environment (paper, section 4.1)."""

CONTROL_TIMESTEP = 0.01
"""Seconds of simulated time in a control step (paper, section 4.1)."""

PHYSICS_STEPS = 50
"""Physics steps of 0.2 ms in a control step, the action held (paper, section 4.1)."""


def known(what: str, value: str, names: Sequence[_Name]) -> _Name:
    """Returns the value if it is one of the names.

    Raises:
        RequestError: if it is none; it says which there are.
    """
    for name in names:
        if name == value:
            return name
    close = difflib.get_close_matches(value, names, 1)
    hint = f"did you mean {close[0]}? Choose" if close else "choose"
    raise RequestError(f"Unknown {what} {value!r}; {hint} {one_of(names)}.")


def one_of(names: Iterable[str]) -> str:
    """Returns names as a sentence offers them: `a, b or c`."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last
