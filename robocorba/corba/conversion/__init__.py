"""Structs of the IDL to values of the domain and back: one module for each subject.

`x(value)` makes the IDL value, `x_of(struct)` the domain's. Servants and remote objects call them.
"""
