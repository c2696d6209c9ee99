"""The recorder for training loops outside jbench, and results as data frames.

recorder.py          `jbench.record`: a run whose training loop is the caller's
request.py           from the arguments of `jbench.record` to the settings of the run
environments.py      environments that report their episodes to the recorder
writer.py            rows and end of a recorded run
sb3.py               callback for stable-baselines3 models
opened.py            `jbench.open`: queries and learning curves as pandas data frames
"""
