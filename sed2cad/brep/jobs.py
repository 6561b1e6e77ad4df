"""What a worker can be asked for. The kernel takes seconds to load: only what does the job loads it."""

from __future__ import annotations

from sed2cad.brep.attempt import AssemblyResult, Attempt, Export, FacetedAttempt, Opening, Verdict


def assemble(attempt: Attempt) -> AssemblyResult:
    """`build.assemble`."""
    from sed2cad.brep import build

    return build.assemble(attempt)


def assemble_faceted(attempt: FacetedAttempt) -> AssemblyResult:
    """`build.assemble_faceted`."""
    from sed2cad.brep import build

    return build.assemble_faceted(attempt)


def judge(attempt: Attempt) -> Verdict:
    """`build.judge`."""
    from sed2cad.brep import build

    return build.judge(attempt)


def opened(opening: Opening) -> AssemblyResult:
    """`opening.opened`."""
    from sed2cad.brep import opening as kernel

    return kernel.opened(opening)


def step_file(export: Export) -> bytes:
    """`convert.step_file`."""
    from sed2cad.brep import convert

    return convert.step_file(export)
