"""The paper's experiment: the latency of one central event channel and of a federation, in two sub-networks."""
