"""The graphic programming agent and its programs, lists of icons with parameters; docs/programs.md is the manual.

graphic_programming is the agent: it builds, checks and writes a program. icons defines the icons, program the file
format, checker the checks before a run, hands the joints that an icon moves to."""
