"""One event channel compared with other brokers: latency, throughput, a stalled consumer, many consumers, memory; and
many idle channels in a mesh."""
