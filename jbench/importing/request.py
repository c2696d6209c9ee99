"""What to import: the format of the files, their columns, and where a seed's number is."""

import re
from typing import Self

from pydantic import Field, model_validator

from jbench.errors import RequestError
from jbench.names import IMPORT_FORMATS, MAX_SEED, ImportFormat, ReturnsName
from jbench.settings.records import Labels
from jbench.wording import in_prose

STEPS = ("control_steps", "global_step", "timesteps", "steps", "step")
RETURN = ("episode_return", "episodic_return", "return", "reward")
"""Most usual columns of a CSV file; `named_columns` has the others."""

TAGS = ("charts/episodic_return", "rollout/ep_rew_mean")
"""Default tags: of CleanRL, an episode each, and of stable-baselines3, means of 100."""

EVALUATION_TAG = "eval/mean_reward"
"""Tag of the evaluations of stable-baselines3."""

_USED_BY = {
    "tag": ("tensorboard",),
    "steps_column": ("csv", "wandb-csv"),
    "return_column": ("csv", "wandb-csv"),
    "seed_column": ("csv",),
    "returns": ("tensorboard", "wandb-csv", "csv"),
}
"""Formats that use an option; others refuse it."""

_NAMED_SEED = re.compile(r"(?:seed|s)[ _=-]?(\d+)", re.IGNORECASE)
"""A seed with a word before its number, such as seed_3."""


class ImportRequest(Labels):
    """What to import."""

    format: ImportFormat = Field(
        title="from", description=f"format of the files: {', '.join(IMPORT_FORMATS)}"
    )
    seed_from: str | None = Field(
        None,
        description="regular expression that finds the seed in a file's path, or in the name of a "
        "run of W&B; its first group, or the whole match",
    )
    tag: str | None = Field(
        None, description=f"tag with the returns, of tensorboard (default: {in_prose(TAGS)})"
    )
    steps_column: str | None = Field(
        None,
        description="column with the control steps, of csv (default: a usual name such as "
        f"{in_prose(STEPS)}) or wandb-csv (default: the first column)",
    )
    return_column: str | None = Field(
        None,
        description="column with the returns, of csv (default: a usual name such as "
        f"{in_prose(RETURN)}) or wandb-csv (the metric)",
    )
    seed_column: str | None = Field(
        None, description="column with the seed, of csv, instead of --seed-from (default: seed)"
    )
    returns: ReturnsName | None = Field(
        None,
        description="kind of the returns: training or evaluation (default: evaluation if the "
        "column or tag begins with eval, else training)",
    )

    @model_validator(mode="after")
    def _has_options_of_its_format(self) -> Self:
        """Raises a RequestError if an option is for another format."""
        for name, formats in _USED_BY.items():
            if getattr(self, name) is not None and self.format not in formats:
                option = f"--{name.replace('_', '-')}"
                raise RequestError(
                    f"{option} is for {in_prose(formats)}; leave it out with --from {self.format}."
                )

        given = [self.seed_from, self.seed_column]
        if None not in given or (given == [None, None] and self.format != "csv"):
            raise RequestError(
                "The number of the seed must come from one place: type --seed-from REGEX, such as "
                r"--seed-from 'seed(\d+)', or with --from csv --seed-column NAME."
            )

        try:
            re.compile(self.seed_from or "")
        except re.error as error:
            raise RequestError(
                f"--seed-from {self.seed_from}: {error}; type a regular expression such as "
                r"'seed(\d+)'."
            ) from None

        return self

    def seed_in(self, text: str, noun: str = "the path") -> int:
        """Returns the seed that `seed_from` finds in a text, which messages call by the noun."""
        match = re.search(self.seed_from or "", text)
        if match is None:
            raise RequestError(
                f"--seed-from {self.seed_from} finds nothing in {noun} {text}; type an expression "
                rf"that matches its seed, such as 'seed(\d+)', or add the seed to the name."
            )
        digits = match[0]
        if match.re.groups:
            digits = match[1]
        return parse_seed(digits or "", f"--seed-from {self.seed_from} finds in {noun} {text}")

    def returns_kind(self, column: str) -> ReturnsName:
        """Returns the kind of the returns in a column or tag."""
        if self.returns is not None:
            return self.returns
        if column.startswith("eval"):
            return "evaluation"
        return "training"


def parse_seed(text: str, where: str) -> int:
    """Returns the seed in a text, a whole number; an error begins with `where`.

    Spreadsheets and data frames with missing values write it as 3.0.
    """
    whole = re.sub(r"\.0*$", "", text.strip())
    digits = whole.lstrip("0") or whole[:1]
    if not (digits.isascii() and digits.isdigit() and int(digits[:20]) <= MAX_SEED):
        problem = f"{where} {text[:40]!r}; a seed is a whole number from 0 up to {MAX_SEED}"
        named = _NAMED_SEED.fullmatch(text.strip())
        if named is not None:
            problem += f"; write {named[1]}"
        raise RequestError(f"{problem}.")

    return int(digits)
