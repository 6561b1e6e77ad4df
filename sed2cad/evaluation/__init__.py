"""How good each part of the pipeline is: the paper's metrics, stricter ones, baselines and ablations."""
