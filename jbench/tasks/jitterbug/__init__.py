"""The Jitterbug: its model, observations, rewards, hand-written policies and five tasks."""
