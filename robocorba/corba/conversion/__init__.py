"""Structs of the IDL to values of the domain and back: one module a subject.

Nothing else knows both sides; servants and commands call it.
"""
