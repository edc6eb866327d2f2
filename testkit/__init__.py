"""Running systems for tests and benches: processes that end with their caller, and the scenes that both use."""
