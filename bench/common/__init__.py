"""What several benches share: processes, network namespaces, buildings, places."""
