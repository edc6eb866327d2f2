"""The graphic programming agent's programs: lists of icons with parameters. docs/programs.md is their manual."""
