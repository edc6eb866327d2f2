"""A robot's body: its joints, where its links are, and how its hands get somewhere."""
