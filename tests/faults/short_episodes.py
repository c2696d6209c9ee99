"""Sets the length of episodes to 20 control steps."""

import jbench.task_specs

jbench.task_specs.EPISODE_STEPS = 20
