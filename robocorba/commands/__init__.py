"""The robocorba command."""
