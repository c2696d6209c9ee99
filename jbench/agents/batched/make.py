"""Builds an engine from settings; a rule that does not keep to what `Rule` describes is refused."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pkgutil import resolve_name
from typing import Any

import torch
from torch import nn

from jbench.agents.batched.autograd import AutogradLearner
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.batched.on_features import OnFeatures
from jbench.agents.batched.on_policy import OnPolicyEngine
from jbench.agents.batched.replay import Batch
from jbench.agents.batched.rule import Rule, make_rule, mean_actor, parameter_names
from jbench.agents.batched.tensors import Tensors
from jbench.agents.environments import Environments
from jbench.agents.memory import memory_error
from jbench.agents.training_loop import CPU
from jbench.devices import check_precision
from jbench.errors import ERRORS_OF_OTHERS, WorkError, sentence_of_failure
from jbench.names import Precision, TimeLimit
from jbench.policies.copied_modules import copy_module
from jbench.settings.algorithms import SETTINGS, AlgorithmSettings, OffPolicySettings, PPOSettings
from jbench.settings.records import OFESettings


def make_batched_engine(
    algo: str | type[Rule],
    settings: AlgorithmSettings,
    environments: Environments,
    *,
    time_limit: TimeLimit = "bootstrap",
    ofe: OFESettings | None = None,
    device: torch.device = CPU,
    precision: Precision = "float32",
    stacked: bool | None = None,
    dtype: torch.dtype = torch.float32,
) -> OffPolicyEngine | OnPolicyEngine:
    """Returns an engine with one untrained agent per seed.

    Args:
        algo: one of `jbench.settings.algorithms.ALGORITHMS`, or an update rule of another package.
        ofe: settings of features learned with the agent (not with PPO); None for no features.
        precision: see `jbench.names.Precision`; parameters are float32 in any case.
        stacked: whether to compute all seeds at once; None for the faster way: on a GPU.
        dtype: of all tensors; tests use float64.

    Raises:
        RequestError: if the device does not have the precision, the number of environments is
            wrong, or `settings.mirror` is not for the encoder of a seed.
        WorkError: if the replay buffers exceed the memory, or the rule can't be trained.
        UnsupportedPolicyError: if the rule's policy can't be saved.
    """
    seeds = len(environments.generators)
    learner = _learner(algo, settings, ofe, environments)
    _set_precision(device, precision)
    make: Any = partial(learner, settings, environments.size, environments.action_size)
    kind: type[OffPolicyEngine | OnPolicyEngine] = OffPolicyEngine
    if isinstance(settings, PPOSettings):
        kind = OnPolicyEngine

    try:
        return kind(
            settings,
            make,
            Tensors(seeds, dtype, device, low_precision=precision == "bfloat16"),
            environments,
            time_limit=time_limit,
            stacked=device.type == "cuda" if stacked is None else stacked,
        )
    except (MemoryError, RuntimeError) as error:
        memory = "memory" if device.type == "cpu" else "GPU's memory"
        explained = memory_error(error, settings, seeds, memory)
        if explained is None:
            raise
        raise explained from None


def _learner(
    algo: str | type[Rule],
    settings: AlgorithmSettings,
    ofe: OFESettings | None,
    environments: Environments,
) -> Callable[..., Learner[Any]]:
    """Returns what makes a learner of an algorithm, or of a rule that has been checked."""
    if not isinstance(algo, str):
        assert isinstance(settings, OffPolicySettings)
        rule = checked_rule(algo, settings, environments.size, environments.action_size)
        return partial(AutogradLearner, rule=rule)
    return own_learner(algo) if ofe is None else on_features(algo, ofe)


def own_learner(algo: str) -> type[Learner[Any]]:
    """Returns the update rule of one of jbench's own algorithms."""
    learner: type[Learner[Any]] = resolve_name(f"jbench.agents.batched.{SETTINGS[algo].learner}")
    return learner


def on_features(algo: str, ofe: OFESettings) -> Callable[..., OnFeatures]:
    """Returns what makes a learner of an off-policy algorithm on learned features.

    Its class derives from `OnFeatures`, which wraps the methods of the update rule that follows it.
    """
    return partial(type("OnFeatures", (OnFeatures, own_learner(algo)), {}), ofe=ofe)


def _set_precision(device: torch.device, precision: Precision) -> None:
    """Sets the precision of matrix products; a RequestError if the device does not have it."""
    check_precision(precision, device.type)
    if device.type == "cuda":
        products = torch.backends.cuda.matmul
        products.fp32_precision = "tf32" if precision == "tf32" else "ieee"
        # Sums are float32, as on a CPU.
        products.allow_bf16_reduced_precision_reduction = False


def checked_rule(
    kind: type[Rule], settings: OffPolicySettings, observation_size: int, action_size: int = 1
) -> Rule:
    """Returns a rule, after updates of a seed and of two in a stack with minibatches of zeros.

    A rule must be computable in a stack on a CPU too: its runs may be resumed on a GPU.
    """
    with torch.random.fork_rng(devices=[]):
        rule = make_rule(kind, settings, observation_size, action_size)
        again = make_rule(kind, settings, observation_size, action_size)
        fault = next(_faults(rule, again, action_size), None)
        if fault is not None:
            raise _unusable(kind, fault)

        try:
            _update(rule, seeds=1)
            _update(rule, seeds=2)
        except ERRORS_OF_OTHERS as error:
            reason = _reason(error)
            fault = f"an update of one or two seeds fails ({reason.rstrip('.')})"
            raise _unusable(kind, fault) from error

    copy_module(mean_actor(rule), observation_size, action_size)
    return rule


def _reason(error: BaseException) -> str:
    """Returns why an update fails: the first sentence of what torch, or code of others, says."""
    text = str(error).removeprefix("vmap: ").partition("\n")[0].partition(". ")[0]
    if isinstance(error, RuntimeError | ValueError) and text:
        return text
    return sentence_of_failure(error)


def _unusable(kind: type[Rule], fault: str) -> WorkError:
    """Returns the error for a rule with a fault, which is a clause."""
    return WorkError(
        f"The rule {kind.__name__} can't be trained: {fault}; docs/your-own-rule.md says what "
        "a rule may do."
    )


def _faults(rule: Rule, again: Rule, action_size: int) -> Iterator[str]:
    """Yields what is wrong with the attributes of a rule, of which `again` has other weights."""
    if rule.action_size != action_size:
        yield "its __init__ does not pass action_size on to Rule.__init__"
    if type(rule).act is not Rule.act:
        yield "it has its own act, but the saved policy is the tanh of its actor's outputs"
    yield from _faults_of_actor(rule, action_size)
    yield from _faults_of_names(rule)

    others = dict(again.named_buffers())
    for name, buffer in rule.named_buffers():
        if not torch.equal(buffer, others[name]):
            yield f"its buffer {name} is random, but seeds share buffers; make it a parameter"

    first = {module: name for name, module in rule.named_modules()}
    for name, module in rule.named_modules(remove_duplicate=False):
        has_parameters = next(module.parameters(), None) is not None
        if name != first[module] and has_parameters:
            yield f"{name} is the module {first[module]}; each must have its own"

    yield from _faults_of_shared_parameters(rule)


def _faults_of_shared_parameters(rule: Rule) -> Iterator[str]:
    """Yields which parameters belong to two attributes, each of which is trained by itself."""
    names: dict[nn.Parameter, str] = {}
    for name, parameter in rule.named_parameters(remove_duplicate=False):
        first = names.setdefault(parameter, name)
        if first.partition(".")[0] != name.partition(".")[0]:
            yield f"{name} is the parameter {first}; each must have its own"


def _faults_of_actor(rule: Rule, action_size: int) -> Iterator[str]:
    """Yields what is wrong with the layers of a rule's actor."""
    actor = getattr(rule, "actor", None)
    last = actor[-1] if isinstance(actor, nn.Sequential) and actor else None
    if not isinstance(last, nn.Linear) or last.bias is None:
        yield "its actor is no nn.Sequential that ends in a Linear layer with a bias"
    elif last.out_features < action_size:
        yield f"its actor has {last.out_features} outputs, and an action has {action_size} numbers"


def _faults_of_names(rule: Rule) -> Iterator[str]:
    """Yields what is wrong with the losses of a rule, and with the names of what they train."""
    losses: Any = rule.losses
    if not isinstance(losses, Mapping):
        yield "its losses are no mapping of the name of a loss to that of what it trains"
        return

    if not rule.losses:
        yield "it has no losses"
    for loss, trained in rule.losses.items():
        if not hasattr(rule, loss) or trained not in parameter_names(rule):
            yield f"it has no method {loss}, or no network or parameter {trained}"

    for name in ("gradients_first", "delayed"):
        names = getattr(rule, name)
        if isinstance(names, str):
            yield f"its {name} is the text {names!r}; type a tuple, ({names!r},)"
            return

    # Settings may leave a loss out of `losses` that is a method still.
    for loss in rule.gradients_first:
        if not hasattr(rule, loss):
            yield f"{loss} is in gradients_first, but it has no such method"

    changing = {*rule.losses.values(), *(f"{name}_target" for name in rule.targets)}
    for name in sorted(set(rule.delayed) - changing):
        yield f"{name} is delayed, but neither trained nor a target network"


def _update(rule: Rule, seeds: int) -> None:
    """Makes an update of initial parameters with a minibatch of zeros, of one seed or a stack.

    This fails if a loss is no number, does not depend on what it trains, draws random numbers,
    changes a buffer or the batch, or has shapes or branches that depend on values.
    """
    observation_size = rule.observation_size
    action_size = rule.action_size
    is_stack = seeds > 1
    make = partial(AutogradLearner, rule.settings, observation_size, action_size, rule=rule)
    tensors = Tensors(seeds)
    learner = make(view=tensors) if is_stack else make(view=tensors.select(0))
    for seed in range(seeds):
        make(view=tensors.select(seed)).initialize(torch.Generator().manual_seed(seed))

    batch_size = rule.settings.batch_size
    shape = (seeds, batch_size) if is_stack else (batch_size,)
    width = observation_size + action_size + 1
    batch = Batch(
        rows=torch.zeros(*shape, width),
        next_rows=torch.zeros(*shape, width),
        discounts=torch.zeros(*shape, 1),
        noise=torch.zeros(*shape, rule.noise_per_transition),
        action_size=action_size,
    )
    before = {name: (tensor, tensor._version) for name, tensor in vars(batch).items()}
    if not is_stack:
        _check_losses(learner.rule, batch)
    learner.update(batch)
    if not _is_unchanged(batch, before):
        raise ValueError("a loss changes the batch, which all losses share")
    if learner.is_stochastic:
        actions = learner.explore(batch.observations, batch.actions)
        returned = tuple(actions.shape[-2:])
        wanted = tuple(batch.actions.shape[-2:])
        if returned != wanted:
            raise ValueError(f"explore returns {returned} numbers, not actions {wanted}")


def _check_losses(rule: Rule, batch: Batch) -> None:
    """Raises a ValueError if a loss of a rule returns anything but one number."""
    for loss in rule.losses:
        value: Any = rule(loss, batch)
        if not isinstance(value, torch.Tensor):
            raise ValueError(f"{loss} returns {value!r:.40}, which is no tensor")
        if value.numel() != 1:
            raise ValueError(f"{loss} returns {value.numel()} numbers, not one")


def _is_unchanged(batch: Batch, before: Mapping[str, tuple[torch.Tensor, int]]) -> bool:
    """Returns whether a batch has the tensors of before, of the same versions, and no others."""
    now = vars(batch)
    return now.keys() == before.keys() and all(
        now[name] is tensor and tensor._version == version
        for name, (tensor, version) in before.items()
    )
