"""How places appear in messages: in metres to the millimetre, also far from the origin (`:g` keeps six digits)."""

from __future__ import annotations


def metres(value: float) -> str:
    """A length or coordinate [m] with at most three decimals, such as 3, 0.25 or 368742.123."""
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def xy(x: float, y: float) -> str:
    """A point [m], such as 3,0.25."""
    return f"{metres(x)},{metres(y)}"


def place(floor: str, x: float, y: float) -> str:
    """A place, such as L1:3,0.25: as `robocorba path` reads it."""
    return f"{floor}:{xy(x, y)}"


def near(x: float, y: float) -> str:
    """Where something is, such as near 3, 0.25."""
    return f"near {metres(x)}, {metres(y)}"
