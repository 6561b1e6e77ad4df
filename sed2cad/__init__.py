"""sed2cad: scan to STEP."""

from __future__ import annotations

__version__ = "0.1.0"
