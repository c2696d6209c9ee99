"""Sets the length of episodes to 20 control steps; import it before other modules of jbench."""

import jbench.names

jbench.names.EPISODE_STEPS = 20
