"""The settings of an import: the learning curve of one seed, made outside jbench."""

from pydantic import Field

from jbench.names import ImportFormat, ReturnsName
from jbench.settings.base import omissible
from jbench.settings.labeled import LabeledSettings


class ImportSettings(LabeledSettings):
    """Settings that identify an import: the content of its files and how they were read."""

    format: ImportFormat
    returns: ReturnsName
    files: list[str] = Field(min_length=1, description="SHA-256 of each file")
    columns: dict[str, str] = omissible(
        {}, description="columns or tags of the file that were read: steps, return, seed"
    )
