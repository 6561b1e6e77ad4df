"""One random part from a seed: a maker drawn by its share, tried until a part is sound."""

from __future__ import annotations

from collections.abc import Callable

from build123d import Solid

from sed2cad.training.synthetic import freeform, prismatic, sheet, turned
from sed2cad.training.synthetic.dice import Dice
from sed2cad.training.synthetic.settle import settled
from sed2cad.training.synthetic.shapes import is_sound

Maker = Callable[[Dice], Solid]

MAKERS: list[tuple[Maker, float]] = [
    (prismatic.plate, 13),
    (prismatic.block, 12),
    (prismatic.simple, 9),
    (prismatic.bracket, 8),
    (prismatic.housing, 6),
    (prismatic.profile_rail, 3),
    (prismatic.hex_nut, 2),
    (prismatic.clamp, 3),
    (sheet.bent_sheet, 7),
    (sheet.flat_sheet, 3),
    (sheet.tray, 2.5),
    (sheet.square_tube, 1.5),
    (turned.shaft, 5),
    (turned.ring, 2),
    (turned.flange, 4),
    (turned.pulley, 2),
    (turned.knob, 2),
    (turned.handwheel, 1),
    (turned.elbow, 1.5),
    (turned.coupling, 1),
    (freeform.cam, 1.5),
    (freeform.blend, 3),
    (freeform.swept, 1),
    (freeform.skinned, 1.7),
    (freeform.impeller, 2.5),
    (freeform.turned_spline, 1.3),
    (freeform.moulded, 2.5),
    (freeform.grip, 0.6),
]
"""The makers and their shares, by the families of real parts: 56 % prismatic, 14 sheet, 14 turned, 16 freeform."""

ATTEMPTS = 12
"""Sub-seeds of a seed that are tried."""
MOST_FACES = 120
"""Real parts of the training set have no more."""


def random_part(seed: int) -> Solid:
    """One valid closed solid, 5 to 200 mm long; the same seed always gives the same one.

    Raises ValueError when none of the seed's sub-seeds gives a sound part.
    """
    for attempt in range(ATTEMPTS):
        try:
            return try_part(seed, attempt)
        except Exception:  # the kernel raises its own errors of many kinds: the next sub-seed
            continue
    raise ValueError(f"seed {seed}: no part in {ATTEMPTS} attempts")


def try_part(seed: int, attempt: int) -> Solid:
    """The part of one sub-seed. Raises ValueError where it is not sound, or an error of the kernel."""
    dice = Dice(seed, attempt)
    maker = dice.pick([maker for maker, _ in MAKERS], [share for _, share in MAKERS])
    part = settled(maker(dice))
    if not is_sound(part):
        raise ValueError(f"{maker.__name__}: not a valid closed solid")
    if len(part.faces()) > MOST_FACES:
        raise ValueError(f"{maker.__name__}: too many faces")
    return part
