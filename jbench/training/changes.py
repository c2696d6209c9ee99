"""What differs here from where a run was recorded: code of users, versions, device."""

from typing import Any

from jbench.agents.find import algorithm_provenance
from jbench.devices import find_device
from jbench.errors import RequestError, WorkError
from jbench.settings.recorded import Unreadable, read_run
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.code import Code, changed_since, check_code
from jbench.store.provenance import device_provenance, differences, last_changes, process_provenance
from jbench.training.code import acting_code, run_code


def changed_code(record: Record, results: Results, accept_changed: bool) -> list[str]:
    """Returns what has changed of the users' code of a run; a ChangedCodeError unless accepted."""
    settings = read_run(record.settings)
    if isinstance(settings, Unreadable):
        return []
    now = _code_at_hand(settings, results)
    if not accept_changed:
        check_code(record, now)
    return changed_since(record, now)


def _code_at_hand(settings: RunSettings | ExternalSettings, results: Results) -> Code:
    """Returns provenance of the users' code of a run, without an algorithm that is not installed.

    Its saved policy acts without the code that has trained it.
    """
    if is_installed(settings):
        return run_code(settings, results)
    return acting_code(settings, results)


def is_installed(settings: RunSettings | ExternalSettings) -> bool:
    """Returns whether the algorithm of a run is at hand, if it is needed: not that of a loop."""
    if isinstance(settings, ExternalSettings):
        return True
    try:
        algorithm_provenance(settings.algo)
    except (RequestError, WorkError):
        return False
    return True


def changes_since(record: Record) -> dict[str, list[Any]]:
    """Returns what may round numbers differently: its values when the run began, and now."""
    now = {**process_provenance(), **device_provenance(find_device(device_here(record)))}
    return differences(record.manifest.provenance, now)


def device_here(record: Record, at_end: bool = False) -> str:
    """Returns the device on which a run began or ended, if it exists here; otherwise `cpu`."""
    on_gpu = recorded_device(record, at_end) == "cuda"
    return find_device("auto" if on_gpu else "cpu").type


def recorded_device(record: Record, at_end: bool) -> str:
    """Returns the device that a run had at its beginning, or at its end."""
    entries = {**record.manifest.provenance}
    if at_end:
        entries |= last_changes(entries)
    return str(entries.get("device", "cpu"))
