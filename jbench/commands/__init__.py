"""The commands of jbench, and how they show their work."""
