"""The surface types that the network tells apart; a class id is an index into `PATCH_TYPES`."""

from __future__ import annotations

PATCH_TYPES = ("plane", "cylinder", "cone", "sphere", "torus", "bspline")
"""Open and closed B-splines are one class; the torus, frequent on real parts, has its own."""

PLANE, CYLINDER, CONE, SPHERE, TORUS, BSPLINE = range(len(PATCH_TYPES))
