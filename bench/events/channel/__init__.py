"""One event channel beside other brokers: latency, throughput, a stalled consumer, many consumers, memory."""
