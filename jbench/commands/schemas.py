"""The schema command."""

from typer import Argument

from jbench import typed_values
from jbench.commands import options, output


def schema(
    name: str | None = Argument(
        None, help="Document of a command, such as train, or a file: manifest, matrix, …"
    ),
    json: bool = options.JSON,
) -> None:
    """Print the JSON schema of a document that --json prints, or of a file.

    Without a name, it lists them; with --json, it prints all schemas.
    """
    from jbench.commands.forms import DOCUMENTS, FILES, schema_of

    if name is not None:
        known = typed_values.known("schema", name, [*DOCUMENTS, *FILES])
        output.raw(f"{output.json_text(schema_of(known))}\n")
        return
    if json:
        output.document({"schemas": {each: schema_of(each) for each in (*DOCUMENTS, *FILES)}})
        return

    rows = []
    for origin, schemas in {"--json of a command": DOCUMENTS, "file": FILES}.items():
        for each, kind in schemas.items():
            meaning, _, _ = (kind.__doc__ or "").strip().partition("\n")
            rows.append((each, origin, meaning))

    output.table("Schemas", ("name", "of", "meaning"), rows)
    output.say("jbench schema NAME prints one as JSON.")
