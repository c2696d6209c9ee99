"""Sets the length of episodes to 20 control steps."""

from tests.short_episodes import shorten_episodes

shorten_episodes(steps=20)
