"""Settings of features that are learned with the agent (Ota et al., 2020, arXiv:2003.01629)."""

import re
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, Field, PositiveInt

from jbench import validation
from jbench.errors import RequestError
from jbench.names import OFE, known

_PREFIX = f"{OFE}."


class OFESettings(BaseModel):
    """Two networks that learn to predict the next observation, in front of actor and critics."""

    model_config = validation.SETTINGS

    units: int = Field(
        ge=2,
        le=1000,
        description="of each network; at most as many as the observation has numbers: the agent "
        "sees the units alone; more: the observation and behind it the units",
    )
    layers: PositiveInt = Field(default=6, description="that share the units; the authors' code")
    learning_rate: float = Field(default=3e-4, gt=0, description="of Adam; the authors' code")
    pretraining: float = Field(
        default=1.0,
        ge=0,
        description="updates of the features for each control step before the agent's first "
        "update, all made then; the authors' code",
    )
    standardize_updates: PositiveInt = Field(
        default=10_000,
        description="updates of the features whose minibatches define mean and standard deviation "
        "of the observations; both are fixed afterwards",
    )

    @property
    def representation(self) -> str:
        """What the agent sees, as it is part of a run's id: ofe12."""
        return f"{OFE}{self.units}"

    @property
    def widths(self) -> list[int]:
        """Units of each layer of a network, as equal as possible, the larger ones first."""
        layers = min(self.layers, self.units)
        return [self.units // layers + (i < self.units % layers) for i in range(layers)]


def requested_ofe(name: str, options: Mapping[str, Any]) -> OFESettings | None:
    """Returns the settings of a representation such as ofe12, or None if it is another one.

    Args:
        name: of a representation, as a user types it.
        options: settings that are not at their defaults.

    Raises:
        RequestError: if the number is missing, or there is no such setting, or not of that value.
    """
    found = re.fullmatch(rf"{OFE}:?([0-9]*)", name)
    if found is None:
        return None
    if not found[1]:
        raise RequestError(f"{name} needs a number of features: type {OFE}12 or {OFE}240.")
    check_options(options)
    return validation.validated(OFESettings, name, units=int(found[1]), **options)


def without_ofe(settings: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Returns settings of an algorithm, and those whose names begin with `ofe.`, without that."""
    own = {name: value for name, value in settings.items() if not name.startswith(_PREFIX)}
    rest = {n.removeprefix(_PREFIX): value for n, value in settings.items() if n not in own}
    return own, rest


def check_options(options: Mapping[str, Any]) -> None:
    """Refuses settings that there are not.

    Raises:
        RequestError: if there is one; it says which there are.
    """
    for option in options:
        known(f"setting of {OFE}", option, [n for n in OFESettings.model_fields if n != "units"])
