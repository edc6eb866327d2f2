"""What a call must raise."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


def refused(error: type[Exception] | tuple[type[Exception], ...], call: Callable[..., Any], *arguments: Any) -> Any:
    """The exception of this kind that the call raises; fails the test where it raises none."""
    with pytest.raises(error) as raised:
        call(*arguments)
    return raised.value
