"""Servants: arguments converted, the domain called, its answer converted."""
