"""The code that a policy by name depends on, and whether it has changed."""

from typing import Any

from jbench import plugins
from jbench.policies.find import is_imported_policy, offered_policies
from jbench.policies.located import locate_run
from jbench.policies.saved import agent_code
from jbench.policies.sb3_zip import is_sb3_zip, zip_content
from jbench.store import Record, Results
from jbench.store.code import changed_files, changed_since, code_hash
from jbench.store.files import sha256


def changed_code(results: Results, name: str) -> str | None:
    """Returns a checksum of the present code of a run's policy if its recorded code is another.

    It is None for an unchanged one, and for policies that are not of a run.
    """
    if "/" not in name or is_sb3_zip(name):
        return None

    run = locate_run(results, name)
    record = run.results.find("run", run.id)
    if record is None:
        return None

    now = agent_code(run.results, record)
    changed = changed_since(record, now)
    if not changed:
        changed = changed_files(_encoder_provenance(run.results, record), now)
    if not changed:
        return None

    return code_hash(now)


def _encoder_provenance(results: Results, run: Record) -> dict[str, Any]:
    """Returns the provenance of a run's encoder, under the names that the run has for it."""
    id = run.settings.get("encoder")
    if id is None:
        return {}

    encoder = results.find("encoder", id)
    if encoder is None:
        return {}
    return {f"encoder_{key}": value for key, value in encoder.manifest.provenance.items()}


def policy_provenance(name: str) -> dict[str, Any]:
    """Returns provenance of the code of a policy of a user; {} for the others."""
    if not is_imported_policy(name):
        return {}
    return plugins.code_provenance("policy", name, offered_policies())


def policy_code(name: str) -> str | None:
    """Returns what identifies the code of a policy that is not jbench's; None for the others.

    It is name and version of its package, or the first 16 digits of the SHA-256 of its file.
    """
    if is_sb3_zip(name):
        return sha256(zip_content(name))[:16]
    made_with = policy_provenance(name)
    checksum: str | None = made_with.get("source_sha256")
    if checksum:
        return checksum[:16]

    package: str | None = made_with.get("package")
    return package
