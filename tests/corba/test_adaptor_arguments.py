"""The arguments of an adaptor in another process."""

from __future__ import annotations

import pytest

from robocorba.corba.remote.adaptor import RemoteAdaptor
from robocorba.errors.robots import AdaptorFailed


def test_arguments_that_nobody_understands_are_refused() -> None:
    adaptor = RemoteAdaptor(None, "A")  # type: ignore[arg-type]
    with pytest.raises(AdaptorFailed, match="--uri"):
        adaptor.start(["--uri"])
