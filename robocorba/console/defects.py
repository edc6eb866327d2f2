"""What users read when the console itself fails."""

from __future__ import annotations

#: In place of an answer; the log has the exception.
DEFECT = "the console failed; its log says why"
