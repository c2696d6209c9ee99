"""Finds out before the training whether an update rule keeps to what `Rule` describes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import cast

import torch
from torch import Tensor, nn

from jbench.agents.batched.autograd import call_stack, differentiate_stack
from jbench.agents.batched.batch import Batch
from jbench.agents.batched.rule import Rule, make_rule, mean_actor, parameter_names
from jbench.errors import WorkError
from jbench.policies.copied import copy_module
from jbench.settings.algorithms import OffPolicySettings


def checked_rule(
    kind: type[Rule], settings: OffPolicySettings, observation_size: int, action_size: int = 1
) -> Rule:
    """Returns a rule, after calling its losses with minibatches of zeros, also of a stack.

    A rule must be computable in a stack on a CPU too: its runs may be resumed on a GPU.

    Raises:
        RequestError: if it is for actions of size 1, and the task's are larger.
        WorkError: if it does not keep to what `Rule` describes.
        UnsupportedPolicyError: if its policy can't be saved.
    """
    sizes = observation_size, action_size
    with torch.random.fork_rng(devices=[]):
        rule, again = (make_rule(kind, settings, *sizes) for _ in range(2))
        fault = next(_faults(rule, again, action_size), None)
    if fault is not None:
        raise WorkError(f"The rule {kind.__name__} can't be trained: {fault}.")
    copy_module(mean_actor(rule), *sizes)
    return rule


def _faults(rule: Rule, again: Rule, action_size: int) -> Iterator[str]:
    """Yields what is wrong with a rule, as clauses.

    Args:
        again: the same rule with other initial weights.
        action_size: of the task.
    """
    if rule.action_size != action_size:
        yield "its __init__ does not pass action_size on to Rule.__init__"
    names = parameter_names(rule)
    actor = getattr(rule, "actor", None)
    if not (isinstance(actor, nn.Sequential) and actor and _is_affine(actor[-1])):
        yield "its actor is no nn.Sequential that ends in a Linear layer with a bias"
    elif (outputs := cast(nn.Linear, actor[-1]).out_features) < action_size:
        yield f"its actor has {outputs} outputs, and an action has {action_size} numbers"
    if not rule.losses:
        yield "it has no losses"
    for loss, trained in rule.losses.items():
        if not hasattr(rule, loss):
            yield f"it has no method {loss}"
        if trained not in names:
            yield f"{loss} trains {trained}, which is no network or parameter of it"
    changing = {*rule.losses.values(), *(f"{name}_target" for name in rule.targets)}
    for name in rule.delayed:
        if name not in changing:
            yield f"{name} is delayed, but neither trained nor a target network"
    yield from _faults_of_modules(rule, again)
    for loss, trained in rule.losses.items():
        yield from _faults_of_loss(rule, loss, [rule.get_parameter(n) for n in names[trained]])
    if type(rule).explore is not Rule.explore:
        batch = _zeros(rule)
        actions = rule.explore(batch.observations, batch.actions)
        if actions.shape != batch.actions.shape:
            shapes = tuple(actions.shape), tuple(batch.actions.shape)
            yield f"explore returns {shapes[0]}, not an action for each observation, {shapes[1]}"
    yield from _faults_of_stack(rule, names)


def _faults_of_modules(rule: Rule, again: Rule) -> Iterator[str]:
    """Yields what is wrong with the modules and buffers of a rule."""
    others = dict(again.named_buffers())
    for name, buffer in rule.named_buffers():
        if not torch.equal(buffer, others[name]):
            yield (
                f"its buffer {name} is random, but seeds share buffers, which are not saved; make "
                "it a parameter"
            )
    for module in rule.modules():
        for name, value in vars(module).items():
            if isinstance(value, Tensor):
                yield f"{name} is a tensor that does not move to a GPU; use register_buffer"
    first = {module: name for name, module in rule.named_modules()}
    for name, module in rule.named_modules(remove_duplicate=False):
        if name != first[module] and any(True for _ in module.parameters()):
            yield f"{name} is the module {first[module]}; each must have its own"


def _faults_of_loss(rule: Rule, loss: str, trained: list[nn.Parameter]) -> Iterator[str]:
    """Yields what is wrong with a loss when it is called."""
    random, buffers = torch.get_rng_state(), [buffer.clone() for buffer in rule.buffers()]
    value = rule(loss, _zeros(rule))
    if not isinstance(value, Tensor) or value.shape != ():
        shape = tuple(value.shape) if isinstance(value, Tensor) else type(value).__name__
        yield f"{loss} returns {shape}, not one number; take the mean over the batch"
    if not torch.equal(torch.get_rng_state(), random):
        yield f"{loss} draws random numbers; use batch.noise, which is drawn for each seed"
    if any(not torch.equal(*pair) for pair in zip(rule.buffers(), buffers, strict=True)):
        yield f"{loss} changes a buffer, such as the statistics of BatchNorm, which is not saved"
    depends = value.requires_grad and any(
        gradient is not None for gradient in torch.autograd.grad(value, trained, allow_unused=True)
    )
    if not depends:
        yield f"{loss} does not depend on {rule.losses[loss]}, which it trains"


def _faults_of_stack(rule: Rule, names: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Yields what can't be computed for two seeds in a stack."""
    parameters = {name: torch.stack([each.detach()] * 2) for name, each in rule.named_parameters()}
    batch = _zeros(rule, 2)
    for loss, trained in rule.losses.items():
        own = {name: parameters[name] for name in names[trained]}
        others = {name: each for name, each in parameters.items() if name not in own}
        yield from _fault_of_call(loss, differentiate_stack, rule, loss, own, others, batch)
    if type(rule).explore is not Rule.explore:
        inputs = batch.observations, batch.actions
        yield from _fault_of_call("explore", call_stack, rule, "explore", parameters, *inputs)


def _fault_of_call(
    method: str, function: Callable[..., object], *arguments: object
) -> Iterator[str]:
    """Yields a fault if a function that maps a method over seeds raises an error."""
    try:
        function(*arguments)
    except RuntimeError as error:
        reason = str(error).removeprefix("vmap: ").partition("\n")[0].partition(". ")[0]
        yield (
            f"torch.func.vmap can't compute {method} for several seeds at once "
            f"({reason.rstrip('.')}); no shape and no branch may depend on values"
        )


def _is_affine(module: nn.Module) -> bool:
    return isinstance(module, nn.Linear) and module.bias is not None


def _zeros(rule: Rule, *seeds: int) -> Batch:
    shape = *seeds, rule.settings.batch_size
    rows = torch.zeros(*shape, rule.observation_size + rule.action_size + 1)
    noise = torch.zeros(*shape, rule.noise_per_transition)
    return Batch(rows, rows, torch.zeros(*shape, 1), noise, rule.action_size)
