"""Settings of runs, datasets and evaluations. Ids contain a hash of them.

    base.py          base class: strict types, canonical JSON and its hash
    algorithms.py    DDPG, PPO, SAC and TD3
    bases.py         sources of their hyperparameters, such as Table 1 and the authors' script
    ofe.py           features learned online with the agent
    run.py           runs, including those that this version can't parse
    labeled.py       base class of the next two: the algorithm is only a label
    external.py      runs whose training loop is not part of jbench
    imported.py      learning curves made by other programs
    specs.py         what the task of another robot is
    dataset.py       random-policy datasets
    evaluation.py    evaluations of a policy
    alike.py         equivalences of settings, and the meaning of omitted settings
    variants.py      names of runs by the settings in which they differ

Settings of encoders are in `encoders/settings.py`, since the kinds of encoders are plug-ins.
"""
