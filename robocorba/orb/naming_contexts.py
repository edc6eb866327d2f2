"""The naming contexts on the way to the names that a process keeps bound."""

from __future__ import annotations

import contextlib
import logging
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import CosNaming
from omniORB import CORBA

from robocorba.orb.bounded_any import invoke
from robocorba.orb.calls import set_call_timeout
from robocorba.orb.ior import address_of

#: Timeout of a call to a naming context [s].
CALL_TIMEOUT_S = 1.0
#: Interval between two log lines about replaced contexts [s].
LOG_INTERVAL_S = 60.0
_log = logging.getLogger(__name__)


class NamingContexts:
    """Any client can unbind or destroy a naming context, or bind one of its own in its place, which answers as it
    likes. What is found in place of a context of this naming service is replaced by the former context, so that all
    names in it are back, or by a new one. uri: stringifies a reference."""

    def __init__(self, uri: Callable[[Any], str]) -> None:
        self._uri = uri
        #: The last usable context of each path, and the address that the naming service gives to its contexts.
        self._former: dict[str, Any] = {}
        self._home = ""
        #: Time of the last log line [s].
        self._logged_at = -math.inf

    def context(self, root: Any, path: Sequence[Any]) -> Any:
        """The context of a path from the root. Calls the naming service only, never what others have bound.

        Raises CORBA.SystemException, and exceptions of NamingContext while others change the same path."""
        context, name = root, ""
        for component in path:
            name = f"{name}/{component.id}.{component.kind}"
            context = self._former[name] = self._inner(root, context, component, self._former.get(name))
        return context

    def _inner(self, root: Any, outer: Any, component: Any, former: Any) -> Any:
        found, is_readable = None, True
        with contextlib.suppress(CosNaming.NamingContext.NotFound, CosNaming.NamingContext.CannotProceed):
            try:
                found = resolve(outer, [component])
            except CORBA.MARSHAL:  # a reference that can't be read
                is_readable = False
        if found is not None and self._is_of(root, found) and _lives(found):
            return _context(found)
        is_theft, now = found is not None or former is not None or not is_readable, time.monotonic()
        if is_theft and now - self._logged_at >= LOG_INTERVAL_S:
            self._logged_at = now
            what = f"an object at {address_of(self._uri(found)) or 'an unknown address'}" if found else "nothing"
            _log.warning("bound the naming context %s again: %s was bound to it", component.id, what)
        with contextlib.suppress(CosNaming.NamingContext.NotFound):
            outer.unbind([component])
        if former is not None and _lives(former):
            outer.rebind_context([component], former)
            return former
        try:
            return _context(outer.bind_new_context([component]))
        except CosNaming.NamingContext.AlreadyBound:  # another process was faster; it is looked at again the next time
            return _context(resolve(outer, [component]))

    def _is_of(self, root: Any, found: Any) -> bool:
        """Whether the naming service itself serves an object. What its address would not reach harms nobody."""
        address = address_of(self._uri(found))
        if address != self._home:  # unknown yet, or the naming service has moved
            example = root.new_context()
            self._home = address_of(self._uri(example))
            _context(example).destroy()
        return address == self._home


def resolve(context: Any, name: list[Any]) -> Any:
    """What is bound to a name, regardless of which client has bound it. Raises CORBA.MARSHAL for a reference that
    omniORBpy can't read."""
    return invoke(context, CosNaming.NamingContext, "resolve", name)


def _context(reference: Any) -> Any:
    context = reference._unchecked_narrow(CosNaming.NamingContext)
    set_call_timeout(context, CALL_TIMEOUT_S)
    return context


def _lives(reference: Any) -> bool:
    """Whether a reference leads to a naming context, which refuses an empty name as invalid."""
    try:
        _context(reference).resolve([])
    except CosNaming.NamingContext.InvalidName:
        return True
    except (CORBA.OBJECT_NOT_EXIST, CORBA.BAD_OPERATION, CosNaming.NamingContext.NotFound):
        pass
    return False
