"""The recorder for training loops outside jbench, and results as data frames.

recorder.py          `jbench.record`: a run whose training loop is the caller's
request.py           from the arguments of `jbench.record` to the settings of the run
environments.py      environments that report their episodes to the recorder
actors.py            calling a torch module, a stable-baselines3 model or a function
networks.py          torch modules as policies that are evaluated without torch
sb3.py               callback and policies of stable-baselines3 models
opened.py            `jbench.open`: queries and learning curves as pandas data frames
"""
