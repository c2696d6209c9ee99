"""Training runs: from settings to committed results."""
