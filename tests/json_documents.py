"""Checks that the JSON document of a command is as `jbench schema` says."""

import json
from functools import cache

import jsonschema

ALIASES = {"train-agent": "train", "train-dae": "train-encoder"}
ROWS = ("query", "tail", "schema")
"""Verbs that print rows of tables, or a schema."""


def check_document(arguments, printed):
    """Asserts that what a command printed fits a document of its verb, or that of an error."""
    verb, *rest = map(str, arguments)
    if "--json" not in rest or verb in ROWS or not printed:
        return

    found = json.loads(printed)
    errors = {name: schema_error(found, name) for name in document_names(ALIASES.get(verb, verb))}
    assert None in errors.values(), errors


@cache
def document_names(verb):
    """Returns the names of the documents that a verb prints."""
    from jbench.commands.forms import DOCUMENTS

    if verb == "train":
        return "train", "train-dry-run", "error"
    return (*(name for name in DOCUMENTS if name == verb or name.startswith(f"{verb}-")), "error")


def schema_error(document, name):
    """Returns where a document does not fit a schema, and why; None if it fits."""
    error = jsonschema.exceptions.best_match(_validator(name).iter_errors(document))
    return error and f"{error.json_path}: {error.message[:500]}"


@cache
def _validator(name):
    from jbench.commands.forms import schema_of

    return jsonschema.Draft202012Validator(schema_of(name))
