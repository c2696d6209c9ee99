"""Agents of many seeds learning side by side in one process; see `docs/architecture.md`."""
