"""Corners and edge curves on primitives: the exact geometry of a traced topology, without any CAD kernel."""
