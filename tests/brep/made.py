"""Solids of the hand-made parts, built once."""

from __future__ import annotations

from functools import cache

from sed2cad.brep.attempt import AssemblyResult, Attempt
from sed2cad.brep.build import assemble
from sed2cad.brep.kernel import from_bytes
from tests.geometry import parts


@cache
def part(name: str) -> parts.Part:
    """A hand-made part."""
    made: parts.Part = getattr(parts, name)()
    return made


@cache
def result(name: str, noise: float = 0.0) -> AssemblyResult:
    """Its assembly."""
    given = part(name).noisy(noise)
    return assemble(Attempt(given.topology, given.fitted, given.frame, part(name).points))


def shape(name: str, noise: float = 0.0):
    """Its solid; a copy of its own for each caller."""
    return from_bytes(result(name, noise).brep)
