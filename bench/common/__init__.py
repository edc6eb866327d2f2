"""What several benches share: the command line, processes, network namespaces, buildings, places."""
