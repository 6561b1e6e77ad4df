"""Milled and moulded parts: plates, blocks, brackets, housings, extruded profiles, hex nuts. z is up."""

from __future__ import annotations

from math import cos, pi, sin

from build123d import Axis, Location, Plane, Solid

from sed2cad.training.synthetic.dice import Dice
from sed2cad.training.synthetic.edges import dress
from sed2cad.training.synthetic.features import OVER, Features, add_boss, add_holes, bore, decorate
from sed2cad.training.synthetic.shapes import (
    Corner,
    Point2,
    Seat,
    box,
    common,
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


def block_seats(x: float, y: float, z: float) -> list[Seat]:
    """The six sides of a block of 2 x by 2 y that stands on z = 0: top, bottom, then the walls."""
    top = Seat(Plane(origin=(0, 0, z)), 0.92 * x, 0.92 * y, z)
    bottom = Seat(Plane(origin=(0, 0, 0), x_dir=(1, 0, 0), z_dir=(0, 0, -1)), 0.92 * x, 0.92 * y, z)
    walls = [
        Seat(Plane((s * x, 0, z / 2), x_dir=(0, 1, 0), z_dir=(s, 0, 0)), 0.9 * y, 0.45 * z, 2 * x) for s in (1, -1)
    ] + [Seat(Plane((0, s * y, z / 2), x_dir=(1, 0, 0), z_dir=(0, s, 0)), 0.9 * x, 0.45 * z, 2 * y) for s in (1, -1)]
    return [top, bottom, *walls]


def plate(dice: Dice) -> Solid:
    """A flat plate with holes, pockets, slots, bosses and ribs on top."""
    x, y = dice.between(15, 60), dice.between(10, 50)
    z = min(x, y) * dice.spread(0.06, 0.5)
    trim = min(x, y) * dice.between(0.05, 0.4) if dice.chance(0.4) else 0
    shape = dice.pick(["rectangle", "disc", "slot", "polygon", "notched"], [6, 0.8, 0.7, 1.2, 2.5])
    if shape == "disc":
        face, x, y = disc(x), 0.68 * x, 0.68 * x
    elif shape == "slot":
        face, y = slot(x, 0.5 * y), 0.5 * y
    elif shape == "polygon":
        face, x, y = outline(regular(dice.whole(3, 8), 1.4 * x, trim)), 0.6 * x, 0.6 * x
    elif shape == "notched":
        face = outline(_notched(dice, x, y, 0.3 * trim))
        x, y = 0.85 * x, 0.85 * y
    else:
        face = outline(rectangle(x, y, trim, dice.chance(0.6)))
    features = Features()
    decorate(dice, features, block_seats(0.95 * x, 0.95 * y, z)[0], 4)
    return dress(dice, features.on(prism(face, z)), dice.whole(0, 2))


def _notched(dice: Dice, x: float, y: float, trim: float) -> list[Corner]:
    """A rectangle with steps or notches in its long sides."""
    points: list[Point2] = []
    for side in (-1, 1):
        points.append((side * x, side * y))
        for k in range(dice.whole(0, 3)):
            a, width = -side * (0.6 - 0.45 * k) * x, dice.between(0.08, 0.18) * x
            deep = side * y * dice.between(0.6, 0.92)
            points += [(-(a + side * width), side * y), (-(a + side * width), deep)]
            points += [(-(a - side * width), deep), (-(a - side * width), side * y)]
        points.append((-side * x, side * y))
    return [Corner(a, b, trim) for a, b in points]


def block(dice: Dice) -> Solid:
    """A block with features on several sides."""
    x, y, z = (dice.between(10, 40) for _ in range(3))
    features = Features()
    for seat in dice.some(block_seats(x, y, z), 4):
        decorate(dice, features, seat, 3)
    trim = 0.3 * min(x, y) if dice.chance(0.3) else 0
    part = features.on(prism(outline(rectangle(x, y, trim, dice.chance(0.6))), z))
    return dress(dice, part, dice.whole(0, 3))


def simple(dice: Dice) -> Solid:
    """Few faces: a block, disc, or profile with one or two features."""
    x, y, z = dice.between(5, 40), dice.between(5, 40), dice.spread(3, 60)
    base = dice.pick(["block", "polygon", "wedge"], [4, 1, 1.5])
    if base == "polygon":
        part = prism(outline(regular(dice.whole(3, 8), x)), z)
        x = y = 0.5 * x
    elif base == "wedge":
        part = prism(outline([Corner(-x, -y), Corner(x, -y), Corner(x, dice.between(-0.6, 1) * y), Corner(-x, y)]), z)
        x, y = 0.5 * x, 0.5 * y
    else:
        part = box((-x, -y, 0), (x, y, z))
    features = Features()
    if dice.chance(0.7):
        add = add_holes if dice.chance(0.8) else add_boss
        add(dice, features, dice.pick(block_seats(x, y, z)[:2]))
    return dress(dice, features.on(part), dice.whole(0, 1), 0.6, (0.01, 0.08))


def bracket(dice: Dice) -> Solid:
    """An L or U of thick legs with holes, and gussets in the corners."""
    x, y, z = dice.between(15, 40), dice.between(10, 40), dice.between(15, 60)
    thick = min(x, y, z) * dice.between(0.1, 0.35)
    trim = thick * dice.between(0.2, 0.9) if dice.chance(0.4) else 0
    legs = [-1] if dice.chance(0.6) else [-1, 1]
    right = [(x, 0), (x, z), (x - thick, z), (x - thick, thick)] if len(legs) == 2 else [(x, 0), (x, thick)]
    points = [(-x, 0.0), *right, (-x + thick, thick), (-x + thick, z), (-x, z)]
    part = prism(outline([Corner(a, b, trim) for a, b in points]), 2 * y, -y).rotate(Axis.X, 90)
    features = Features()
    base = Seat(Plane(origin=(0.5 * thick, 0, thick)), 0.8 * (x - thick), 0.9 * y, thick)
    decorate(dice, features, base, 3)
    for leg in legs:
        plane = Plane((leg * x, 0, (z + thick) / 2), x_dir=(0, 1, 0), z_dir=(leg, 0, 0))
        decorate(dice, features, Seat(plane, 0.9 * y, 0.42 * (z - thick), thick), 2)
        if dice.chance(0.5):
            reach = dice.between(0.4, 0.9) * min(z - thick, (1.5 if len(legs) == 1 else 0.8) * x - thick)
            low = -leg * (x - thick + OVER) * -1, thick - OVER
            side = [Corner(*low), Corner(low[0] - leg * reach, low[1]), Corner(low[0], low[1] + reach)]
            wide = thick * dice.between(0.3, 1)
            rib = prism(outline(side), wide, -0.5 * wide).rotate(Axis.X, 90)
            count = dice.whole(1, 3)
            shifts = [0.0] if count == 1 else [-0.9 * y + 1.8 * y * k / (count - 1) for k in range(count)]
            features.add += [rib.moved(Location((0, s * (1 - 0.5 * wide / y), 0))) for s in shifts]
    return dress(dice, features.on(part), dice.whole(0, 3))


def housing(dice: Dice) -> Solid:
    """An open box or can of thin walls, with bosses, a flange, vents and wall holes."""
    x, y, z = dice.between(15, 50), dice.between(12, 40), dice.between(8, 50)
    small = min(x, y)
    wall, trim = small * dice.spread(0.04, 0.16), small * dice.between(0.2, 0.6) if dice.chance(0.5) else 0.0
    part = prism(outline(rectangle(x, y, trim)), z)
    inner = max(trim - wall, 0.0)
    hollow = prism(outline(rectangle(x - wall, y - wall, inner)), z, wall)
    hollow = dress(dice, hollow, int(dice.chance(0.25)), 1.0)
    features = Features()
    if dice.chance(0.4):
        wide = wall * dice.between(1.5, 3)
        rim = prism(outline(rectangle(x + wide, y + wide, trim + wide if trim else 0)), wall, z - wall)
        features.add.append(rim)
        hole = bore(dice, 0.3 * wide, wall, True)
        places = [(a * (x + 0.5 * wide), b * 0.7 * y) for a in (-1, 1) for b in (-1, 0, 1)]
        features.remove += [hole.moved(Location((a, b, z))) for a, b in places]
    for seat in dice.some(block_seats(x, y, z), 3)[-2:]:
        thin = Seat(seat.plane, 0.8 * seat.x - 0.5 * trim, 0.8 * seat.y, 1.5 * wall)
        if thin.x > wall:
            decorate(dice, features, thin, 3)
    shell = cut(part, [hollow])
    posts = Features(features.add, [*features.remove, *_posts(dice, features, x, y, z, wall, trim)])
    return dress(dice, posts.on(shell), dice.whole(0, 2), 0.5, (0.003, 0.012))


def _posts(dice: Dice, features: Features, x: float, y: float, z: float, wall: float, trim: float) -> list[Solid]:
    """Screw posts on the floor of a housing, added to the features; their holes are returned."""
    if dice.chance(0.4):
        return []
    radius, height = wall * dice.between(1.0, 2.2), z * dice.between(0.3, 0.95)
    profile = [(0, 0.5 * wall), (radius * dice.pick([1.0, 1.25]), 0.5 * wall), (radius, height), (0, height)]
    post = revolve(outline([Corner(a, b) for a, b in profile]))
    hole = bore(dice, 0.5 * radius, height, False)
    inset = wall + 0.3 * trim + dice.between(0.8, 1.6) * radius
    places = [(a * (x - inset), b * (y - inset)) for a in (-1, 1) for b in (-1, 1)]
    if inset + 1.2 * radius > min(x, y):
        places = [(0.0, 0.0)]
    features.add += [post.moved(Location((a, b, 0))) for a, b in places]
    return [hole.moved(Location((a, b, height))) for a, b in places]


def profile_rail(dice: Dice) -> Solid:
    """A long extrusion: T, I, C, T-slotted or toothed section, with holes across."""
    size, length = dice.between(8, 25), dice.between(20, 150)
    thick = size * dice.between(0.12, 0.3)
    kind = dice.pick(["t", "i", "c", "slots", "teeth"])
    s, t = size, thick
    sections: dict[str, list[Point2]] = {
        "t": [(-s, 0), (s, 0), (s, t), (t / 2, t), (t / 2, s), (-t / 2, s), (-t / 2, t), (-s, t)],
        "i": [(-s, -s), (s, -s), (s, t - s), (t / 2, t - s), (t / 2, s - t), (s, s - t), (s, s), (-s, s), (-s, s - t),
              (-t / 2, s - t), (-t / 2, t - s), (-s, t - s)],
        "c": [(-s, -s), (s, -s), (s, -0.6 * s), (s - t, -0.6 * s), (s - t, t - s), (t - s, t - s), (t - s, s - t),
              (s - t, s - t), (s - t, 0.6 * s), (s, 0.6 * s), (s, s), (-s, s)],
        "slots": _t_slots(s, t, dice.between(0.35, 0.6)),
        "teeth": _teeth(dice, s),
    }  # fmt: skip
    trim = 0.3 * thick if dice.chance(0.4) else 0
    length = length if kind != "teeth" else 0.3 * length
    part = prism(outline([Corner(a, b, trim) for a, b in sections[kind]]), length)
    hole = bore(dice, 0.3 * size, 4 * size, True).rotate(Axis.X, -90)
    holes = [hole.moved(Location((0, 2 * size, length * (k + 0.5) / 5))) for k in range(dice.whole(0, 5))]
    if kind in ("slots", "teeth"):
        holes = [bore(dice, 0.3 * size * dice.between(0.4, 1), length, True).moved(Location((0, 0, length)))]
    return dress(dice, cut(part, holes), dice.whole(0, 1))


def _t_slots(size: float, thick: float, deep: float) -> list[Point2]:
    """A square with a T slot in each side."""
    mouth, wide, low = 0.25 * size, 0.25 * size + 0.8 * thick, (1 - deep) * size
    lip = min(0.5 * thick, 0.4 * deep * size)
    wide = min(wide, 0.9 * low)
    side = [(-size, -size), (-mouth, -size), (-mouth, -size + lip), (-wide, -size + lip), (-wide, -low), (wide, -low),
            (wide, -size + lip), (mouth, -size + lip), (mouth, -size)]  # fmt: skip
    points: list[Point2] = []
    for _ in range(4):
        points += side
        side = [(-b, a) for a, b in side]
    return points


def _teeth(dice: Dice, size: float) -> list[Point2]:
    """A toothed wheel."""
    count, inner = dice.whole(6, 24), dice.between(0.7, 0.9) * size
    points: list[Point2] = []
    for k in range(count):
        for radius, part in ((inner, 0.05), (size, 0.25), (size, 0.5), (inner, 0.7)):
            angle = 2 * pi * (k + part) / count
            points.append((radius * cos(angle), radius * sin(angle)))
    return points


def hex_nut(dice: Dice) -> Solid:
    """A nut or bolt head: hexagon cut by cones, bored or with a shank."""
    radius = dice.between(5, 20)
    height = radius * dice.between(0.5, 1.6)
    drop = 0.14 * radius * dice.between(0.6, 1.5)
    edge = radius * dice.between(0.88, 0.97)
    profile = [(0, 0), (edge, 0), (1.1 * radius, drop), (1.1 * radius, height - drop), (edge, height), (0, height)]
    if dice.chance(0.5):
        profile[1:3] = [(1.1 * radius, 0)]
    part = common(prism(outline(regular(6, radius)), height), [revolve(outline([Corner(*p) for p in profile]))])
    hole, top = radius * dice.between(0.3, 0.65), Location((0, 0, height))
    if dice.chance(0.6):
        return cut(part, [bore(dice, hole, height, True).moved(top)])
    end = -radius * dice.between(1, 6)
    shank = [(0, OVER), (hole, OVER), (hole, end + 0.1 * radius), (0.85 * hole, end), (0, end)]
    return join(part, [revolve(outline([Corner(*p) for p in shank]))])


def clamp(dice: Dice) -> Solid:
    """A lever: eyes joined by a bar, bored; often split at one eye."""
    big, small, length = dice.between(8, 20), dice.between(5, 14), dice.between(25, 70)
    low, high = dice.between(3, 10), dice.between(5, 20)
    eyes = [prism(disc(big), high), prism(disc(small), low + dice.between(0, 8)).moved(Location((length, 0, 0)))]
    width = 0.8 * min(big, small) * dice.between(0.5, 1)
    sides = [(0, -width), (length, -width * 0.8), (length, width * 0.8), (0, width)]
    bar = prism(outline([Corner(a, b) for a, b in sides]), low)
    part = join(bar, eyes)
    tools = [bore(dice, big * dice.between(0.3, 0.7), 60, True).moved(Location((0, 0, high)))]
    tools.append(bore(dice, small * dice.between(0.3, 0.6), 60, True).moved(Location((length, 0, 30))))
    if dice.chance(0.5):
        gap = big * dice.between(0.05, 0.15)
        tools.append(box((-2 * big, -gap, -1), (0, gap, 40)))
    if dice.chance(0.4) and low > 4:
        tools.append(prism(slot(0.2 * length, 0.6 * width), low, 0.5 * low).moved(Location((0.5 * length, 0, 0))))
    return dress(dice, cut(part, tools), dice.whole(1, 3))
