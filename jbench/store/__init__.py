"""The results database: identity, layout, atomic writes and SQL. See `docs/architecture.md`."""

from jbench.store.database import Results
from jbench.store.record import Record

__all__ = ["Record", "Results"]
