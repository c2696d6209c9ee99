"""Settings of runs, datasets and evaluations: what is hashed into an id.

    base.py          what all settings share: strict classes, canonical JSON, its hash
    algorithms.py    of DDPG, PPO, SAC and TD3
    ofe.py           of features that are learned with an agent
    run.py           of a run, and of runs that this version can't parse
    external.py      of a run whose training loop is not part of jbench
    dataset.py       of a random-policy dataset
    evaluation.py    of an evaluation of a policy
    alike.py         which settings are alike, and what an omitted one means

Settings of encoders are in `encoders/settings.py`, since the kinds of encoders are plug-ins.
"""
