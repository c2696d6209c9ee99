"""What to say of a command line that typer refuses."""

import itertools
from collections.abc import Collection, Sequence

import typer

from jbench import wording
from jbench.representation_names import ENCODER_KINDS

_INSTEAD_OF_VERBS = {
    "encoders": "query 'FROM encoders'",
    "list": "runs",
    "ls": "runs",
    "plot": "report",
}
_INSTEAD_OF_VERBS |= {f"train-{kind}": f"train-encoder --kind {kind}" for kind in ENCODER_KINDS}
"""Commands that users may look for, and what to type instead."""

_INSTEAD_OF_OPTIONS = {
    "--n-envs": "--environments",
    "--num-envs": "--environments",
    "--timesteps": "--steps",
    "--total-timesteps": "--steps",
    "--env": "--task",
    "--lr": "--set learning_rate=VALUE",
}
"""Options that users may look for, and what to type instead."""


def refusal(error: typer.TyperException, arguments: Sequence[str], verbs: Collection[str]) -> str:
    """Returns what is wrong with the arguments, and the help that lists the right ones.

    Args:
        error: typer's, of these arguments.
        arguments: as typed, without `jbench`.
        verbs: all that there are.
    """
    message = " ".join(error.format_message().replace("Value error, ", "").split()).rstrip(".")
    context: typer.Context | None = getattr(error, "ctx", None)

    if context is None or context.parent is None:
        verb = next(iter(arguments), "")
        instead = _INSTEAD_OF_VERBS.get(verb)
        if instead is not None:
            message = f"No such command '{verb}'; type jbench {instead} instead"
        elif verb.startswith("-"):
            message += _option_before_verb(arguments, verbs)
    else:
        verb = context.info_name or ""
        message = _verb_refusal(message, error, context, arguments)

    if not message.endswith("?"):
        message += ";"
    if verb in verbs:
        return f"{message} jbench {verb} --help lists the options and shows an example."

    return f"{message} jbench --help lists the commands."


def _option_before_verb(arguments: Sequence[str], verbs: Collection[str]) -> str:
    """Returns what to type if an option stands before its command; else nothing."""
    for word in arguments:
        if word in verbs:
            return f"; options stand after the command: type jbench {word} {arguments[0]} …"

    return ""


def _verb_refusal(
    message: str, error: typer.TyperException, context: typer.Context, arguments: Sequence[str]
) -> str:
    """Returns what is wrong with the arguments of a verb, and what to type instead if we know."""
    option = getattr(error, "option_name", "")
    if option:
        instead = _instead_of_option(option)
        flag, _, _ = instead.partition(" ")
        if any(flag in parameter.opts for parameter in context.command.params):
            return f"No such option: {option}; type {instead} instead"

    if "unexpected extra argument" in message:
        hint = _instead_of_setting(arguments)
        if not hint and context.info_name == "report":
            hint = "type --curves FILE, or --results DIR"
        if hint:
            return f"{message}: {hint}"
        return message

    if message.startswith("Missing option"):
        missing = _missing_options(context, arguments)
        if len(missing) > 1:
            return f"Missing options {wording.in_prose(missing, 'and')}"

    return message


def _instead_of_option(option: str) -> str:
    """Returns what to type instead of an option that there is not; empty if we don't know."""
    if option in _INSTEAD_OF_OPTIONS:
        return _INSTEAD_OF_OPTIONS[option]

    from jbench.settings.algorithms import SETTINGS  # imports pydantic: seldom needed

    name = option.removeprefix("--").replace("-", "_")
    if any(name in settings.model_fields for settings in SETTINGS.values()):
        return f"--set {name}=VALUE"

    return ""


def _instead_of_setting(arguments: Sequence[str]) -> str:
    """Returns how to type a value after --set that has a space in or before it; or nothing."""
    for i, word in enumerate(arguments[:-1]):
        if word != "--set":
            continue

        name, equals, value = arguments[i + 1].partition("=")
        rest = list(itertools.takewhile(lambda word: not word.startswith("-"), arguments[i + 2 :]))
        if rest and not equals:
            return f"type --set {name}={' '.join(rest)}"
        if rest and value.startswith("["):
            return f"type --set {name}={value}{''.join(rest)}"

    return ""


def _missing_options(context: typer.Context, arguments: Sequence[str]) -> list[str]:
    """Returns the options that a verb requires and that were not typed."""
    typed = {word.partition("=")[0] for word in arguments}
    return [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.required
        and parameter.opts[0].startswith("-")
        and typed.isdisjoint(parameter.opts)
    ]
