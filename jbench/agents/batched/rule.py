"""Base class of the update rules of other packages; `docs/your-own-rule.md` has examples.

`jbench.rules` has DDPG, TD3 and SAC as rules.

A package registers a rule by an entry point of the group `jbench.rules`, named as in
`jbench train --algo`, and whose value is its class.
"""

import copy
import inspect
from collections.abc import Mapping
from typing import Any, ClassVar, final

from torch import Tensor, nn

from jbench.errors import RequestError, WorkError
from jbench.names import SettingsBase
from jbench.settings.algorithms import OffPolicySettings
from jbench.settings.algorithms.base import Changes


class Rule(nn.Module):
    """An off-policy update rule, written for one seed; autograd differentiates its losses.

    Its networks and learned numbers are attributes, as in any module of torch. The engine collects
    the transitions, samples the minibatches and steps the optimizers, for any number of seeds.

    A loss is a method of a `Batch` that returns one number. It may use all networks; only those
    that it trains are differentiated, so the others need not be detached. It depends on nothing but
    the parameters and the batch: random numbers come from `batch.noise`, and it keeps nothing. It
    leaves the batch as it is, which the losses share. No shape and no branch depends on values,
    since torch.func.vmap computes the seeds of a stack.

    The attribute `actor` is an nn.Sequential that ends in a Linear layer. tanh of its first
    `action_size` outputs is the deterministic action.

    Attributes:
        Settings: class of its settings, the names and defaults of `--set`. All of them are
            recorded, and are part of a run's id.
        losses: names of the methods that return a loss, in the order of the updates, and of the
            attribute that each one trains by a step of Adam. The mean of those with a column in the
            table `episodes`, such as critic_loss and actor_loss, is recorded. Set it in `__init__`
            if it depends on the settings.
        gradients_first: names of losses whose gradients are all computed before the first of their
            steps, at the place of the first of them in `losses`.
        targets: attributes with a target network, which is called NAME_target and updated after the
            losses: target <- (1 - tau) target + tau network.
        delayed: attributes, target networks among them, that only delayed updates change.
        noise_per_transition: standard normal numbers in `batch.noise` for each transition; set in
            `__init__` if it depends on the sizes.
        bases: sources of hyperparameters for `--settings`, and in what each differs from the
            defaults of `Settings`. A task's own source is used as for jbench's algorithms.
        settings: an object of `Settings`.
        observation_size: size of an (encoded) observation.
        action_size: size of an action; 1 for the Jitterbug.
    """

    Settings: ClassVar[type[OffPolicySettings]] = OffPolicySettings
    bases: ClassVar[Mapping[SettingsBase, Changes]] = {}
    losses: Mapping[str, str] = {}
    gradients_first: tuple[str, ...] = ()
    targets: ClassVar[tuple[str, ...]] = ()
    delayed: ClassVar[tuple[str, ...]] = ()
    noise_per_transition: int = 0

    def __init__(self, settings: Any, observation_size: int, action_size: int = 1) -> None:
        """Makes the networks with initial weights from torch's global generator.

        The engine seeds it before. An override calls this first. A rule whose override does not
        take `action_size` is for actions of size 1.
        """
        super().__init__()
        self.settings = settings
        self.observation_size = observation_size
        self.action_size = action_size

    @final
    def act(self, observations: Tensor) -> Tensor:
        """Returns deterministic actions (N, action_size) for observations (N, size)."""
        actor: Any = self.actor
        actions: Tensor = actor(observations)[..., : self.action_size].tanh()
        return actions

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """Returns actions (N, action_size) of a stochastic policy.

        Without this method, `act` explores. The action noise of the settings is added to both.

        Args:
            observations: (N, size).
            noise: (N, action_size) standard normal numbers.
        """
        raise NotImplementedError

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """Returns whether an update changes the attributes in `delayed`, too.

        Args:
            update: number since the start of training, counted from 1.
            update_of_call: number within the current learning phase, counted from 0.
        """
        return True

    def forward(self, method: str, *arguments: Any) -> Tensor:
        """Calls a method: `torch.func.functional_call` only calls modules."""
        result: Tensor = getattr(self, method)(*arguments)
        return result


def make_rule(
    kind: type[Rule], settings: OffPolicySettings, observation_size: int, action_size: int = 1
) -> Rule:
    """Returns a rule with its target networks, whose weights are those of the networks.

    Raises:
        RequestError: if it is for actions of size 1, and the task's are larger.
        WorkError: if a network with a target does not exist.
    """
    arguments = inspect.signature(kind).parameters
    forms = {argument.kind for argument in arguments.values()}
    if "action_size" in arguments:
        rule = kind(settings, observation_size, action_size=action_size)
    elif action_size == 1:
        rule = kind(settings, observation_size)
    elif inspect.Parameter.VAR_KEYWORD in forms:
        rule = kind(settings, observation_size, action_size=action_size)
    elif inspect.Parameter.VAR_POSITIONAL in forms:
        rule = kind(settings, observation_size, action_size)
    else:
        raise RequestError(
            f"The rule {kind.__name__} is for tasks with one action, and this task has "
            f"{action_size}: add the argument action_size to its __init__ "
            "(docs/your-own-rule.md), or choose another task."
        )
    targets: Any = rule.targets
    if isinstance(targets, str):
        raise WorkError(
            f"The targets of the rule {kind.__name__} are the text {targets!r}; type a tuple, "
            f"({targets!r},)."
        )

    for name in rule.targets:
        if not hasattr(rule, name):
            raise WorkError(f"The rule {kind.__name__} has no {name}, which is among its targets.")
        setattr(rule, f"{name}_target", copy.deepcopy(getattr(rule, name)))
    return rule


def parameter_names(rule: Rule) -> dict[str, list[str]]:
    """Returns the names of the parameters of each attribute that has any."""
    names: dict[str, list[str]] = {}
    for name, _ in rule.named_parameters():
        names.setdefault(name.partition(".")[0], []).append(name)
    return names


def mean_actor(rule: Rule) -> nn.Sequential:
    """Returns a copy of the actor up to the deterministic action, in float32 on the CPU."""
    actor: Any = rule.actor
    *layers, last = copy.deepcopy(actor).float().cpu()
    size = rule.action_size
    mean = nn.Linear(last.in_features, size)
    mean.load_state_dict({name: values[:size] for name, values in last.state_dict().items()})
    return nn.Sequential(*layers, mean, nn.Tanh())


def phases(rule: Rule) -> list[list[str]]:
    """Returns the losses of a rule in their order, those together whose gradients come first."""
    together = [loss for loss in rule.losses if loss in rule.gradients_first]
    alone = [[loss] for loss in rule.losses if loss not in rule.gradients_first]
    if not together:
        return alone
    place = list(rule.losses).index(together[0])
    return [*alone[:place], together, *alone[place:]]
