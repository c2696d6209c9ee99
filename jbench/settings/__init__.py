"""Settings of runs, datasets and evaluations. Ids contain a hash of them.

    base.py          base class: strict types, canonical JSON and its hash
    algorithms.py    DDPG, PPO, SAC and TD3
    bases.py         sources of their hyperparameters, such as Table 1 and the authors' script
    run.py           runs
    recorded.py      recorded runs, including those that this version can't parse
    records.py       datasets, evaluations, recorded training loops and imported curves
    alike.py         equivalences of settings, and the meaning of omitted settings
    variants.py      names of runs by the settings in which they differ

Settings of encoders are in `encoders/registry.py`, since the kinds of encoders are plug-ins.
"""
