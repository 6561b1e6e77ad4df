"""Parts with faces that are no primitives: spline profiles, lofts, sweeps, skins, blades, turned splines."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Any

import numpy as np
from build123d import Axis, Edge, Face, Location, Plane, Solid, Vector, Wire

from sed2cad.training.synthetic.dice import Dice
from sed2cad.training.synthetic.edges import dress
from sed2cad.training.synthetic.features import OVER, Features, add_boss, add_holes, bore, decorate
from sed2cad.training.synthetic.prismatic import block_seats
from sed2cad.training.synthetic.shapes import (
    Corner,
    Point2,
    Seat,
    around,
    blob,
    common,
    cut,
    disc,
    join,
    largest,
    outline,
    prism,
    rectangle,
    regular,
    revolve,
    rod,
    smooth,
)


def _wavy(dice: Dice, radius: float, waves: float) -> list[Point2]:
    """Points round the origin at radii that vary by `waves`."""
    count, stretch = 2 * dice.whole(3, 8), dice.between(0.6, 1.0)
    radii = [radius * dice.between(1 - waves, 1) for _ in range(count)]
    return [(r * cos(2 * pi * k / count), stretch * r * sin(2 * pi * k / count)) for k, r in enumerate(radii)]


def cam(dice: Dice) -> Solid:
    """A plate with a smooth outline, holes, bosses and smooth pockets or windows."""
    radius = dice.between(15, 50)
    height, room = radius * dice.spread(0.1, 1), 0.35 * radius
    features = Features()
    decorate(dice, features, Seat(Plane((0, 0, height)), room, room, height), 3)
    if dice.chance(0.5):
        window = prism(
            blob(_wavy(dice, 0.12 * radius, 0.4), dice.chance(0.4)), height * dice.pick([0.5, 2]) + OVER, -0.5 * height
        )
        places = [(0.46 * radius * cos(a), 0.3 * radius * sin(a)) for a in (0.3, 2.0, 3.6, 5.0)]
        features.remove += [window.moved(Location((*p, 0.7 * height))) for p in dice.some(places, 4)]
    part = features.on(prism(blob(_wavy(dice, radius, 0.35), dice.chance(0.6)), height))
    return dress(dice, part, dice.whole(0, 1), 0.5, (0.006, 0.02))


def blend(dice: Dice) -> Solid:
    """A loft between unlike sections, with a foot, a bore, sometimes hollow."""
    radius, height = dice.between(10, 35), dice.between(15, 60)
    count = dice.pick([2, 3])
    sides = dice.pick([4, 5, 6, 8, 12])
    ruled = count == 2 and dice.chance(0.4)
    turn = dice.between(0.1, 0.6)
    round_end = dice.chance(0.25)

    def skin(shrink: float) -> Solid:
        wires = []
        for k in range(count):
            size = radius * sizes[k] - shrink
            place = Location((0, 0, height * k / (count - 1)))
            face = outline(regular(sides, size, 0.25 * size if rounded else 0, turn * k))
            face = disc(size) if round_end and k == count - 1 else face
            wires.append(face.outer_wire().moved(place))
        return Solid.make_loft(wires, ruled)

    sizes, rounded = [dice.between(0.45, 1) for _ in range(count)], dice.chance(0.3)
    part = largest(skin(0).wrapped)
    if dice.chance(0.35):
        part = cut(part, [largest(skin(radius * 0.1).wrapped)])
    if dice.chance(0.5):
        foot = outline(rectangle(1.2 * radius, 1.1 * radius, 0.2 * radius))
        part = join(part, [prism(foot, 0.15 * height, -0.1 * height)])
        hole = bore(dice, 0.08 * radius, 0.15 * height, True)
        places = [(a * 1.03 * radius, b * 0.95 * radius, 0.05 * height) for a in (-1, 1) for b in (-1, 1)]
        part = cut(part, [hole.moved(Location(p)) for p in places])
    if dice.chance(0.4):
        part = cut(part, [bore(dice, 0.2 * radius, height, True).moved(Location((0, 0, height)))])
    return dress(dice, part, dice.whole(0, 1), 0.4, (0.005, 0.015))


def swept(dice: Dice) -> Solid:
    """A section along a smooth curve between two ends: a hook, a handle, a duct."""
    size, span = dice.between(2, 6), dice.between(30, 80)
    count = dice.whole(3, 5)
    rises = [0.0, *(dice.between(0.2, 0.5) * span for _ in range(count - 2)), 0.0]
    points: list[Any] = [Vector(span * k / (count - 1), rise, 0) for k, rise in enumerate(rises)]
    path = Wire([Edge.make_spline(points, tangents=[Vector(0, 1, 0), Vector(0, -1, 0)])])
    kind = dice.pick(["disc", "rectangle", "hexagon"])
    face = {
        "disc": disc(size),
        "rectangle": outline(rectangle(size, 0.6 * size, 0.25 * size)),
        "hexagon": outline(regular(6, size)),
    }[kind]
    start = Plane(origin=(0, 0, 0), x_dir=(1, 0, 0), z_dir=(0, 1, 0))
    part = largest(Solid.sweep(face.moved(Location(start)), path).wrapped)
    ends: list[Solid] = []
    tools: list[Solid] = []
    thick = size * dice.between(0.6, 1.5)
    for x in (0.0, span):
        place = Location(Plane((x, 0, 0), x_dir=(1, 0, 0), z_dir=(0, -1, 0)))
        base = outline(rectangle(2.4 * size, 2 * size, 0.6 * size)) if dice.chance(0.5) else disc(2 * size)
        ends.append(prism(base, thick + OVER, -OVER).moved(place))
        hole = bore(dice, 0.3 * size, thick, True)
        if base.area > 15 * size**2:
            tools += [hole.moved(place * Location((s * 1.75 * size, 0, thick))) for s in (-1, 1)]
        tools.append(bore(dice, 0.4 * size, 2 * thick, False).moved(place * Location((0, 0, thick))))
    return dress(dice, cut(join(part, ends), tools), dice.whole(0, 2), 0.4, (0.004, 0.012))


def skinned(dice: Dice) -> Solid:
    """A block whose top is a freeform surface, with holes, pockets and bosses, sometimes hollow below."""
    x, y, z = dice.between(15, 45), dice.between(12, 40), dice.between(8, 30)
    wave = 0.3 * z
    n, m = dice.whole(3, 5), dice.whole(3, 5)
    across, along = np.linspace(-1.3 * x, 1.3 * x, n), np.linspace(-1.3 * y, 1.3 * y, m)
    rows: Any = [[Vector(a, b, z - dice.between(0, wave)) for b in along] for a in across]
    skin = Face.make_surface_from_array_of_points(rows)
    below = Solid.extrude(skin, Vector(0, 0, -3 * z))
    trim = min(x, y) * dice.between(0.05, 0.4)
    part = common(prism(outline(rectangle(x, y, trim, dice.chance(0.8))), 2 * z, 0), [below])
    if dice.chance(0.4):
        wall = 0.12 * min(x, y)
        hollow = prism(outline(rectangle(x - wall, y - wall, max(trim - wall, 0.2))), 2 * z, -z)
        part = cut(part, [common(hollow, [below.translate((0, 0, -wall))])])
    features = Features()
    for seat in dice.some(block_seats(x, y, 0.6 * z), 3):
        if seat.plane.z_dir.Z > 0.5:
            top = Seat(Plane((0, 0, z)), 0.9 * x, 0.9 * y, 1.2 * wave + 1)
            add_holes(dice, features, top)
        else:
            decorate(dice, features, Seat(seat.plane, 0.8 * seat.x, 0.8 * seat.y, 0.3 * z), 3)
    return dress(dice, features.on(part), dice.whole(0, 1), 0.4, (0.004, 0.012))


def impeller(dice: Dice) -> Solid:
    """A hub with twisted or curved blades, on a disc or free."""
    radius = dice.between(18, 50)
    hub, height = radius * dice.between(0.25, 0.4), radius * dice.between(0.3, 0.8)
    count, thick = dice.whole(4, 12), radius * dice.spread(0.03, 0.08)
    if dice.chance(0.5):
        bend, reach = dice.between(0.15, 0.5) * radius, radius
        line = [(0.6 * hub, 0.0), (0.6 * reach, -0.5 * bend), (reach, -bend - thick)]
        back = [(reach, -bend), (0.6 * reach, -0.5 * bend + 1.3 * thick), (0.6 * hub, 1.2 * thick)]
        edges = [smooth(line), Edge.make_line(line[-1], back[0]), smooth(back), Edge.make_line(back[-1], line[0])]
        blade = prism(Face(Wire(edges)), 0.8 * height, 0.05 * height)
    else:
        wires = []
        for r, pitch in ((0.6 * hub, 55), (0.6 * radius, 35), (radius, 20)):
            section = outline(rectangle(0.5 * thick, 0.42 * height)).rotate(Axis.Z, pitch).outer_wire()
            wires.append(section.moved(Location(Plane((r, 0, 0.5 * height), x_dir=(0, 1, 0), z_dir=(1, 0, 0)))))
        blade = largest(Solid.make_loft(wires).wrapped)
    nose = Corner(hub * dice.pick([1, 0.8]), height, 0.2 * hub, dice.chance(0.5))
    body = [revolve(outline([Corner(0, 0), Corner(hub, 0), nose, Corner(0, height)]))]
    if dice.chance(0.5):
        body.append(prism(disc(1.05 * radius), 0.1 * height))
    part = join(body[0], [*body[1:], *around(count, blade)])
    part = cut(part, [bore(dice, hub * dice.between(0.3, 0.6), height, True).moved(Location((0, 0, height)))])
    return dress(dice, part, dice.whole(0, 1), 0.5, (0.003, 0.008))


def turned_spline(dice: Dice) -> Solid:
    """A handle, vase or nozzle: a smooth curve turned about z, solid or hollow, with flats and holes."""
    radius, height = dice.between(8, 25), dice.between(20, 80)
    count = dice.whole(3, 6)
    radii = [radius * dice.between(0.45, 1) for _ in range(count)]
    heights = [height * k / (count - 1) for k in range(count)]

    def body(shrink: float) -> Solid:
        curve = [(r - shrink, z) for r, z in zip(radii, heights)]
        edges = [Edge.make_line((0, 0), curve[0]), smooth(curve)]
        edges += [Edge.make_line(curve[-1], (0, height)), Edge.make_line((0, height), (0, 0))]
        return revolve(Face(Wire(edges)))

    part = body(0)
    if dice.chance(0.4):
        part = cut(part, [body(0.12 * radius)])
    elif dice.chance(0.7):
        part = cut(part, [bore(dice, 0.2 * radius, height, dice.chance(0.5)).moved(Location((0, 0, height)))])
    if dice.chance(0.5):
        part = join(part, [prism(disc(1.2 * radii[0]), 0.08 * height, -0.06 * height)])
    if dice.chance(0.4):
        tools = around(dice.whole(2, 6), rod(0.15 * radius, 3 * radius, (0, 0, 0.4 * height), (1, 0, 0)))
        part = cut(part, tools)
    return dress(dice, part, dice.whole(0, 1), 0.5, (0.006, 0.02))


def moulded(dice: Dice) -> Solid:
    """A drafted, smoothly outlined shell with posts, a lip and holes: a cover of plastic."""
    radius = dice.between(18, 50)
    height, wall = radius * dice.between(0.2, 0.7), radius * dice.spread(0.04, 0.1)
    points = _wavy(dice, radius, 0.25)
    draft, pieces = dice.between(0.8, 0.95), dice.chance(0.75)

    def shell(shrink: float, z: float) -> Solid:
        scale = 1 - shrink / radius
        wires = [blob([(scale * k * x, scale * k * y) for x, y in points], pieces).outer_wire() for k in (1.0, draft)]
        return Solid.make_loft([wires[0].moved(Location((0, 0, -z))), wires[1].moved(Location((0, 0, height - z)))])

    part = largest(shell(0, 0).wrapped)
    part = dress(dice, part, int(dice.chance(0.3)), 1.0, (0.01, 0.03))
    part = cut(part, [largest(shell(1.3 * wall, wall).wrapped)])
    features = Features()
    below = Plane(origin=(0, 0, height - wall), x_dir=(1, 0, 0), z_dir=(0, 0, -1))
    decorate(dice, features, Seat(below, 0.4 * radius, 0.3 * radius, wall), 3)
    add = dice.pick([add_holes, add_boss])
    add(dice, features, Seat(Plane((0, 0, height)), 0.4 * radius, 0.35 * radius, wall))
    return features.on(part)


def grip(dice: Dice) -> Solid:
    """A block or shaft with a row of freeform scallops or embossed waves."""
    x, y, z = dice.between(20, 50), dice.between(8, 25), dice.between(8, 25)
    count = dice.whole(3, 9)
    features = Features()
    pitch = 2 * x / count
    for seat in dice.some(block_seats(x, y, z)[:1] + block_seats(x, y, z)[4:], 3):
        shape = blob(_wavy(dice, 0.4 * pitch, 0.4), dice.chance(0.6))
        deep = 0.2 * min(y, z)
        if dice.chance(0.5):
            tool = prism(shape, deep + OVER, -deep)
            long = min(1.0, 0.8 * seat.y / (0.4 * pitch))
            tool = tool if long == 1.0 else tool.scale(long)
        else:
            tool = prism(blob(_wavy(dice, min(0.35 * pitch, deep), 0.3)), 4 * y, -2 * y).rotate(Axis.X, 90)
        features.remove += [tool.moved(seat.at(-x + (k + 0.5) * pitch, 0)) for k in range(count)]
    part = features.on(prism(outline(rectangle(x, y, 0.3 * y, dice.chance(0.7))), z))
    if dice.chance(0.5):
        part = join(part, [rod(0.3 * z, 1.5 * x, (0.9 * x, 0, 0.5 * z), (1, 0, 0))])
    return dress(dice, part, dice.whole(0, 1), 0.5, (0.004, 0.012))
