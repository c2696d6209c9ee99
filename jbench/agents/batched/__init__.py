"""The default training engine: many seeds of an algorithm in one process.

    tensors.py       tensors of all seeds, stacked, and scratch memory; adam.py: their optimizer
    layers.py        affine layers with hand-written gradients; network.py: networks of them
    learner.py       base of the update rules; ddpg.py, td3.py, sac.py, ppo.py: one rule each
    features.py      features learned with an agent; on_features.py: the update rules on them
    rule.py          base class of other packages' rules; autograd.py: trains them
    replay.py        replay buffers and minibatches; updates.py: updates from them
    pair_buffer.py   replay buffers of robots whose episodes end early
    normalize.py     inputs standardized by running statistics
    engine.py        the agents of all seeds; off_policy.py, on_policy.py: the two kinds of engines
    graphs.py        CUDA graphs
    make.py          jbench's update rules by name; checks other rules; makes an engine

Every update rule is written once, for tensors with or without a leading axis of seeds. On a CPU
the seeds are computed one after another: a seed's numbers do not depend on the other seeds, bit for
bit, and training is reproducible.

On a GPU all seeds are computed in one stack. Random numbers are still drawn on the CPU, so a seed
sees the same robots, minibatches and noise. Which kernel multiplies a stack depends on its size,
so a seed trained with others agrees with the same seed trained alone only to rounding, and the two
diverge after some thousand steps. The kernels add in a fixed order, so the same seeds on the same
GPU with the same libraries should give the same numbers.
"""
