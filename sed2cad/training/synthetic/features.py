"""Features that sit on flat places: holes and their patterns, pockets, bosses, grooves, ribs."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, pi, sin

from build123d import Axis, Location, Solid

from sed2cad.training.synthetic.dice import Dice
from sed2cad.training.synthetic.shapes import (
    Corner,
    Point2,
    Seat,
    apart,
    cut,
    disc,
    join,
    outline,
    prism,
    rectangle,
    regular,
    revolve,
    slot,
)

OVER = 0.5
"""Tools reach this many mm out of the material, so that no two faces coincide."""


@dataclass
class Features:
    """Solids to add to a part and, after that, solids to take away from it."""

    add: list[Solid] = field(default_factory=list)
    remove: list[Solid] = field(default_factory=list)

    def on(self, part: Solid) -> Solid:
        """The part with the features."""
        return cut(join(part, self.add), self.remove)


def bore(dice: Dice, radius: float, depth: float, through: bool) -> Solid:
    """The tool of a hole down from z = 0: plain, bevelled, counterbored or countersunk, with a flat or drill tip."""
    end = -depth - OVER if through else -dice.between(0.3, 0.75) * depth
    head = dice.pick(["plain", "bevel", "bore", "sink"], [4, *([2, 1.5, 2] if dice.conical else [0, 1, 0])])
    wide, step = radius * dice.between(1.5, 2.0), min(radius * dice.between(0.4, 1.0), 0.5 * -end)
    profile: list[Point2] = [(0, OVER)]
    if head == "bevel":
        bevel = min(0.25 * radius, 0.3 * -end)
        profile += [(radius + bevel, OVER), (radius + bevel, 0), (radius, -bevel)]
    elif head == "bore":
        profile += [(wide, OVER), (wide, -step), (radius, -step)]
    elif head == "sink":
        profile += [(wide, OVER), (wide, 0), (radius, -min(wide - radius, 0.6 * -end))]
    else:
        profile += [(radius, OVER)]
    profile += [(radius, end)]
    tip = -end + 0.6 * radius < 0.9 * depth
    profile += [(0, end - 0.58 * radius)] if dice.conical and not through and tip else [(0, end)]
    return revolve(outline([Corner(x, y) for x, y in profile]))


def pattern(dice: Dice, x: float, y: float, radius: float) -> list[Point2]:
    """Centres of holes of one radius in a rectangle of 2 x by 2 y."""
    x, y = x - 1.5 * radius, y - 1.5 * radius
    if x < 0 or y < 0:
        return []
    kind = dice.pick(["one", "row", "grid", "circle", "corners", "free"], [4, 1.5, 0.8, 1, 1.5, 1])
    if kind == "one":
        return [(0.0, 0.0)]
    if kind == "circle":
        ring, count = min(x, y), dice.whole(3, 8)
        turn = dice.between(0, pi)
        places = [(ring * cos(turn + 2 * pi * k / count), ring * sin(turn + 2 * pi * k / count)) for k in range(count)]
    elif kind == "corners":
        places = [(a * x, b * y) for a in (-1, 1) for b in (-1, 1)]
    elif kind == "free":
        places = [(dice.between(-x, x), dice.between(-y, y)) for _ in range(dice.whole(2, 5))]
    else:
        nx, ny = dice.whole(2, 5), 1 if kind == "row" else dice.whole(2, 3)
        if x < y:
            nx, ny = ny, nx
        places = [(_spaced(x, i, nx), _spaced(y, j, ny)) for i in range(nx) for j in range(ny)]
    return apart(places, 2.8 * radius)


def _spaced(half: float, k: int, count: int) -> float:
    return 0.0 if count == 1 else -half + 2 * half * k / (count - 1)


def add_holes(dice: Dice, features: Features, seat: Seat) -> None:
    """A pattern of equal holes."""
    room = min(seat.x, seat.y)
    radius = room * dice.spread(0.06, 0.5)
    tool = bore(dice, radius, seat.depth, dice.chance(0.7))
    features.remove += [tool.moved(seat.at(a, b)) for a, b in pattern(dice, seat.x, seat.y, 1.3 * radius)]


def add_pocket(dice: Dice, features: Features, seat: Seat) -> None:
    """A pocket or window: rectangle, disc, slot or hexagon, sometimes with an island."""
    x, y = seat.x * dice.between(0.4, 0.85), seat.y * dice.between(0.4, 0.85)
    small = min(x, y)
    depth = seat.depth * (dice.between(0.15, 0.75) if dice.chance(0.7) else 2.0)
    kind = dice.pick(["rectangle", "disc", "slot", "polygon", "ball"], [6, 1, 1, 1.5, 0.7])
    if kind == "slot" and abs(x - y) > 0.2 * small:
        face = slot(max(x, y) - small, small).rotate(Axis.Z, 0 if x > y else 90)
    elif kind == "disc":
        face = disc(small)
    elif kind == "ball":
        radius = small * dice.between(0.2, 0.7)
        ball = Solid.make_sphere(radius).translate((0, 0, radius - min(depth, 0.8 * radius, 0.8 * seat.depth)))
        features.remove += [ball.moved(seat.at(*place)) for place in pattern(dice, x, y, 0.9 * radius)]
        return
    elif kind == "polygon":
        face = outline(regular(dice.whole(3, 8), small, (0.2 * small if dice.chance(0.4) else 0)))
    else:
        face = outline(rectangle(x, y, small * dice.between(0.05, 0.5) if dice.chance(0.25) else 0))
    tool = prism(face, OVER + depth, -depth)
    if dice.chance(0.15) and small > 2:
        tool = cut(tool, [prism(disc(0.45 * small), depth * 0.8 + OVER, -depth - OVER)])
    features.remove.append(tool.moved(seat.at(0, 0)))


def add_boss(dice: Dice, features: Features, seat: Seat) -> None:
    """Raised cylinders, cones, blocks or hexagons, often with a hole."""
    radius = min(seat.x, seat.y) * dice.between(0.15, 0.6)
    height = radius * dice.spread(0.3, 2.5)
    kind = dice.pick(
        ["rod", "taper", "block", "hexagon", "stepped", "dome"], [3, 3 if dice.conical else 0, 3, 1.5, 1, 1]
    )
    bottom = -min(OVER, 0.5 * seat.depth)
    if kind == "block":
        side = rectangle(radius, radius * dice.between(0.5, 1), 0.3 * radius if dice.chance(0.5) else 0)
        tool = prism(outline(side), height - bottom, bottom)
    elif kind == "hexagon":
        tool = prism(outline(regular(6, radius)), height - bottom, bottom)
    else:
        profile = [(0, bottom), (radius, bottom)]
        if kind == "stepped":
            profile += [(radius, 0.5 * height), (0.6 * radius, 0.5 * height), (0.6 * radius, height)]
        else:
            profile += [(radius * (dice.between(0.6, 0.9) if kind == "taper" else 1), height)]
        tool = revolve(outline([Corner(a, b) for a, b in [*profile, (0, height)]]))
    if kind == "dome":
        tool = join(tool, [Solid.make_sphere(radius).translate((0, 0, height))])
    places = pattern(dice, seat.x, seat.y, radius)
    hole = bore(dice, radius * dice.between(0.2, 0.4), height + seat.depth, dice.chance(0.4))
    for place in places:
        features.add.append(tool.moved(seat.at(*place)))
    if kind != "dome" and dice.chance(0.6):
        features.remove += [hole.moved(seat.at(*place, height)) for place in places]


def add_grooves(dice: Dice, features: Features, seat: Seat) -> None:
    """Parallel channels, half round, rectangular, V or dovetail, across the seat or ending in it."""
    count = dice.whole(1, 4)
    pitch = 2 * seat.y / count
    half, depth = pitch * dice.between(0.1, 0.35), 0.0
    depth = min(half * dice.spread(0.5, 3), 0.6 * seat.depth)
    kind = dice.pick(["rectangle", "v", "dovetail", "slot"], [4, 1, 0.7, 1.5])
    if kind == "slot":
        end = max(0.9 * seat.x - half, 0.2 * half)
        tool = prism(slot(end, half), OVER + depth * dice.pick([1, 5]), -depth)
        tool = tool if dice.chance(0.5) else tool.moved(Location((0, 0, -seat.depth)))
    else:
        bottom = {"rectangle": half, "v": 0.02 * half, "dovetail": 1.35 * half}[kind]
        corners = [(-half, OVER), (-half, 0), (-bottom, -depth), (bottom, -depth), (half, 0), (half, OVER)]
        length = seat.x * dice.pick([0.8, 1.5, 1.5])
        tool = prism(outline([Corner(a, b) for a, b in corners]), 2 * length, -length)
        tool = tool.rotate(Axis.X, 90).rotate(Axis.Z, 90)
    features.remove += [tool.moved(seat.at(0, -seat.y + (k + 0.5) * pitch)) for k in range(count)]


def add_ribs(dice: Dice, features: Features, seat: Seat) -> None:
    """Thin upright walls, parallel or crossed."""
    count = dice.whole(1, 6)
    thick, height = min(seat.x, seat.y) * dice.spread(0.03, 0.15), min(seat.x, seat.y) * dice.between(0.2, 0.9)
    bottom = -min(OVER, 0.5 * seat.depth)
    lengths = dice.between(0.5, 0.98) * seat.x
    low = height * (dice.between(0.2, 0.8) if dice.chance(0.3) else 1)
    side = [Corner(-lengths, bottom), Corner(lengths, bottom), Corner(lengths, low), Corner(-lengths, height)]
    wall = prism(outline(side), thick, -0.5 * thick).rotate(Axis.X, 90)
    for k in range(count):
        features.add.append(wall.moved(seat.at(0, _spaced(0.85 * seat.y, k, count))))
    if dice.chance(0.3):
        across = prism(outline(rectangle(0.5 * thick, 0.9 * seat.y)), min(low, height) * 0.9 - bottom, bottom)
        features.add.append(across.moved(seat.at(dice.between(-0.4, 0.4) * seat.x, 0)))


def decorate(dice: Dice, features: Features, seat: Seat, cells: int = 3) -> None:
    """Divide a seat into up to `cells` by `cells` parts and put a feature on some of them."""
    long = dice.whole(1, cells)
    short = dice.whole(1, max(1, cells - 1))
    nx, ny = (long, short) if seat.x > seat.y else (short, long)
    kinds = [add_holes, add_pocket, add_boss, add_grooves, add_ribs]
    weights = [4.2, 2.7, 1.4, 1.3, 1.2]
    same = dice.pick(kinds, weights) if dice.chance(0.25) else None
    for i in range(nx):
        for j in range(ny):
            if dice.chance(0.33):
                continue
            x, y = seat.x / nx, seat.y / ny
            plane = seat.plane.offset(0)
            plane.origin = seat.at(-seat.x + (2 * i + 1) * x, -seat.y + (2 * j + 1) * y).position
            cell = Seat(plane, 0.92 * x, 0.92 * y, seat.depth)
            (same or dice.pick(kinds, weights))(dice, features, cell)
