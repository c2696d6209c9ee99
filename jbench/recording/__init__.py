"""The recorder for training loops outside jbench, and results as data frames.

request.py           `jbench.record`: from its arguments to the settings of the run
recorder.py          a run whose training loop is the caller's
writer.py            rows and end of a recorded run, and environments that write rows
opened.py            `jbench.open`: queries and learning curves as pandas data frames
"""
