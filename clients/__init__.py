"""Programs that call the servers: example clients and the demo."""
