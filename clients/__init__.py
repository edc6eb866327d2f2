"""Programs that call the servers: examples to begin from, and the demo."""
