"""Turned parts about z: shafts, rings, flanges, pulleys, knobs and handwheels."""

from __future__ import annotations

from math import pi, sin

from build123d import Axis, Location, Plane, Solid

from sed2cad.training.synthetic.dice import Dice
from sed2cad.training.synthetic.edges import dress
from sed2cad.training.synthetic.features import OVER, bore
from sed2cad.training.synthetic.shapes import (
    Corner,
    around,
    box,
    cut,
    disc,
    join,
    largest,
    outline,
    prism,
    regular,
    revolve,
    rod,
    slot,
)


def _trim(dice: Dice, room: float) -> tuple[float, bool]:
    """How a corner of a profile is cut: not, bevelled (a cone) or rounded (a torus)."""
    kind = dice.pick(["sharp", "bevel", "round"], [0.6, 0.22, 0.18])
    return (0.0 if kind == "sharp" else room * dice.spread(0.06, 0.3)), kind == "round"


def stepped(dice: Dice, steps: int, radius: float, step: float) -> tuple[list[Corner], list[float]]:
    """The outer profile of a stepped shaft from z = 0 up, and the z where its steps end."""
    corners, ends, z = [], [0.0], 0.0
    for _ in range(steps):
        here, length = radius * dice.between(0.4, 1), step * dice.spread(0.3, 2)
        room = 0.4 * min(here, length)
        top = here * (dice.between(0.6, 0.95) if dice.chance(0.1) else 1)
        corners.append(Corner(here, z, *_trim(dice, room)))
        if dice.chance(0.2):
            deep, wide = 0.12 * here, 0.15 * length
            middle = z + 0.5 * length
            deepest = [Corner(here - deep, middle - 0.5 * wide), Corner(here - deep, middle + 0.5 * wide)]
            if dice.chance(0.3):
                deepest = [Corner(here - deep, middle)]
            corners += [Corner(here, middle - 0.5 * wide), *deepest, Corner(here, middle + 0.5 * wide)]
        z += length
        corners.append(Corner(top, z, *_trim(dice, room)))
        ends.append(z)
    return corners, ends


def shaft(dice: Dice) -> Solid:
    """A stepped shaft with grooves, bevels, a keyway, flats, cross holes and a bore."""
    radius = dice.between(5, 20)
    steps = dice.pick([1, 2, 3, 4, 5, 6], [3, 3, 2, 1.5, 1, 0.7])
    corners, ends = stepped(dice, steps, radius, radius * dice.spread(0.5, 3))
    length, thin = ends[-1], min(c.x for c in corners)
    part = revolve(outline([Corner(0, 0), *corners, Corner(0, length)]))
    tools = []
    if dice.chance(0.5):
        hole = bore(dice, thin * dice.between(0.3, 0.7), length, dice.chance(0.6))
        tools.append(hole.moved(Location((0, 0, length))))
    middle = 0.5 * (ends[0] + ends[1])
    reach = 0.5 * (ends[1] - ends[0])
    if dice.chance(0.2):
        key = prism(slot(0.5 * reach, 0.2 * thin), 2 * radius, 0.75 * corners[0].x)
        tools.append(key.rotate(Axis.Y, 90).translate((0, 0, middle)))
    if dice.chance(0.2):
        across = rod(min(0.25 * thin, 0.5 * reach), 4 * radius, (-2 * radius, 0, middle), (1, 0, 0))
        tools.append(across)
    if dice.chance(0.15):
        flat = corners[0].x * dice.between(0.75, 0.92)
        tools += around(dice.pick([1, 2, 4]), box((flat, -2 * radius, -1), (2 * radius, 2 * radius, reach)))
    return cut(part, tools)


def ring(dice: Dice) -> Solid:
    """A washer, bush or thin tube of few faces."""
    radius = dice.between(5, 40)
    inner, height = radius * dice.between(0.4, 0.95), radius * dice.spread(0.05, 4)
    room = 0.4 * min(radius - inner, height)
    corners = [Corner(inner, 0, *_trim(dice, room)), Corner(radius, 0, *_trim(dice, room))]
    if dice.chance(0.35):
        collar = radius * dice.between(1.1, 1.5)
        corners += [Corner(collar, 0), Corner(collar, 0.2 * height, *_trim(dice, room)), Corner(radius, 0.2 * height)]
        corners[1] = Corner(collar - 0.05 * radius, 0)
    corners += [Corner(radius, height, *_trim(dice, room)), Corner(inner, height, *_trim(dice, room))]
    part = revolve(outline(corners))
    if dice.chance(0.3):
        hole = rod(min(0.3 * height, 0.4 * inner) * dice.between(0.3, 0.9), 3 * radius, (0, 0, 0.6 * height), (1, 0, 0))
        part = cut(part, around(dice.whole(1, 6), hole))
    return part


def flange(dice: Dice) -> Solid:
    """A disc with a hub, bore and bolt circles; sometimes with spokes' windows."""
    radius = dice.between(20, 60)
    thick, hub = radius * dice.between(0.08, 0.3), radius * dice.between(0.25, 0.5)
    tall = thick * dice.between(1.2, 5) if dice.chance(0.75) else thick
    top = hub * (dice.between(0.75, 0.95) if dice.chance(0.35) else 1)
    room = 0.5 * min(thick, radius - hub)
    corners = [Corner(0, 0), Corner(radius, 0, *_trim(dice, room)), Corner(radius, thick, *_trim(dice, room))]
    if tall > 1.05 * thick:
        corners += [Corner(hub, thick, *_trim(dice, room)), Corner(top, tall, *_trim(dice, room))]
    part = revolve(outline([*corners, Corner(0, tall)]))
    tools = []
    if dice.chance(0.85):
        tools.append(bore(dice, hub * dice.between(0.35, 0.75), tall, dice.chance(0.85)).moved(Location((0, 0, tall))))
    between = 0.5 * (hub + radius)
    for low, high in [(hub, radius)] if dice.chance(0.7) else [(hub, between), (between, radius)]:
        size = (high - low) * dice.between(0.1, 0.28)
        count = min(dice.whole(3, 16), int(pi * (high + low) / 3.5 / size))
        hole = bore(dice, size, thick, dice.chance(0.9))
        tools += around(count, hole.moved(Location((0.5 * (low + high), 0, thick))), dice.between(0, 90))
    part = cut(part, tools)
    if dice.chance(0.3) and tall > 2 * thick:
        side = [Corner(0.9 * top, 0.5 * thick), Corner(0.8 * radius, 0.5 * thick), Corner(0.8 * radius, 1.1 * thick),
                Corner(0.95 * top, 0.95 * tall), Corner(0.9 * top, 0.9 * tall)]  # fmt: skip
        rib = prism(outline(side), 0.3 * thick, -0.15 * thick).rotate(Axis.X, 90)
        part = join(part, around(dice.whole(3, 6), rib))
    return dress(dice, part, dice.whole(0, 1))


def pulley(dice: Dice) -> Solid:
    """A wheel with V, round or flat grooves, a hub, a bore, windows and a set screw."""
    radius, height = dice.between(15, 50), dice.between(6, 25)
    count = dice.whole(1, 4)
    pitch = height / count
    corners = [Corner(0, 0), Corner(radius, 0, *_trim(dice, 0.2 * pitch))]
    kind = dice.pick(["v", "round", "flat"])
    for k in range(count):
        low, high = (k + 0.15) * pitch, (k + 0.85) * pitch
        deep = radius - 0.35 * pitch * dice.between(0.8, 1.3)
        inset = {"v": 0.25, "round": 0.18, "flat": 0.0}[kind] * pitch
        trim = 0.15 * pitch if kind == "round" else 0.0
        corners += [Corner(radius, low), Corner(deep, low + inset, trim)]
        corners += [Corner(deep, high - inset, trim), Corner(radius, high)]
    hub, tall = radius * dice.between(0.3, 0.5), height * dice.between(1.1, 2)
    corners.append(Corner(radius, height, *_trim(dice, 0.2 * pitch)))
    corners += [Corner(hub, height), Corner(hub, tall), Corner(0, tall)]
    tools = [bore(dice, 0.5 * hub, tall, True).moved(Location((0, 0, tall)))]
    if dice.chance(0.5):
        size = 0.3 * (0.75 * radius - hub)
        window = prism(disc(size), 3 * tall, -tall).translate((0.5 * (hub + 0.8 * radius), 0, 0))
        tools += around(dice.whole(3, 6), window)
    if dice.chance(0.4):
        tools.append(rod(0.2 * (tall - height), 2 * radius, (0, 0, 0.5 * (tall + height)), (1, 0, 0)))
    return cut(revolve(outline(corners)), tools)


def knob(dice: Dice) -> Solid:
    """A ball, dome, lobed or fluted knob on a stem, bored or not."""
    radius = dice.between(8, 25)
    stem, tall = radius * dice.between(0.3, 0.6), radius * dice.between(0.8, 2.5)
    kind = dice.pick(["ball", "dome", "disc"], [3, 3, 4])
    if kind == "ball":
        head = Solid.make_sphere(radius, angle1=-90, angle2=90, angle3=360).translate((0, 0, tall))
    elif kind == "dome":
        base = prism(disc(radius), tall, 0)
        head = join(base.translate((0, 0, 0.4 * tall)), [Solid.make_sphere(radius).translate((0, 0, 1.4 * tall))])
    else:
        head = prism(disc(radius), 0.6 * radius, tall)
        if dice.chance(0.7):
            count = dice.whole(3, 9)
            size = radius * sin(pi / count) * dice.between(0.3, 0.7)
            flute = prism(disc(size), 2 * radius, tall - OVER).translate((radius * dice.between(1.0, 1.05), 0, 0))
            head = cut(head, around(count, flute))
        head = dress(dice, head, dice.whole(0, 2), 0.8, (0.01, 0.05))
    foot = [Corner(0, 0), Corner(stem * dice.pick([1.0, 1.3]), 0, *_trim(dice, 0.3 * stem)), Corner(stem, tall + OVER)]
    part = join(revolve(outline([*foot, Corner(0, tall + OVER)])), [head])
    if dice.chance(0.6):
        part = cut(part, [bore(dice, 0.5 * stem, tall, False).rotate(Axis.X, 180)])
    return dress(dice, part, dice.whole(0, 2), 0.8)


def handwheel(dice: Dice) -> Solid:
    """A torus rim on spokes round a hub, or a ring handle on a shank."""
    radius = dice.between(25, 60)
    rim, hub = radius * dice.between(0.06, 0.14), radius * dice.between(0.15, 0.3)
    tall, count = 2 * rim * dice.between(0.8, 2), dice.whole(2, 6)
    ring_ = Solid.make_torus(radius, rim)
    spoke_radius = rim * dice.between(0.35, 0.75)
    spoke = rod(spoke_radius, radius, (0, 0, 0), (1, 0, 0))
    if dice.chance(0.4):
        spoke = box((0, -spoke_radius, -0.5 * spoke_radius), (radius, spoke_radius, 0.5 * spoke_radius))
    shape = disc(hub) if dice.chance(0.8) else outline(regular(6, hub))
    part = join(prism(shape, tall, -0.5 * tall), [ring_, *around(count, spoke)])
    part = cut(part, [bore(dice, hub * dice.between(0.3, 0.7), tall, True).moved(Location((0, 0, 0.5 * tall)))])
    if dice.chance(0.4):
        side = [Corner(0, 0), Corner(rim * 0.8, 0), Corner(rim, 3 * rim), Corner(0.7 * rim, 5 * rim, rim)]
        part = join(part, [revolve(outline([*side, Corner(0, 5 * rim)])).translate((radius, 0, 0))])
    return dress(dice, part, dice.whole(0, 1))


def elbow(dice: Dice) -> Solid:
    """A pipe bend between straight ends with flanges; the bend is a torus, hollow or full."""
    radius, bend = dice.between(4, 12), dice.between(1.5, 3)
    reach, inner = radius * bend, radius * dice.between(0.5, 0.85)
    straight = radius * dice.between(1, 5)
    angle = dice.pick([45, 60, 90, 90, 120, 180])

    def pipe(size: float) -> list[Solid]:
        turn = Solid.revolve(disc(size).rotate(Axis.X, 90).translate((reach, 0, 0)), angle, Axis.Z)
        entry = rod(size, straight, (reach, -straight, 0), (0, 1, 0))
        leave = rod(size, straight, (reach, 0, 0), (0, 1, 0)).rotate(Axis.Z, angle)
        return [turn, entry, leave]

    outer = pipe(radius)
    wide, thick = 1.6 * radius, 0.4 * radius
    collars = [
        rod(wide, thick, (reach, -straight, 0), (0, 1, 0)),
        rod(wide, thick, (reach, straight - thick, 0), (0, 1, 0)).rotate(Axis.Z, angle),
    ]
    part = join(outer[0], outer[1:] + collars[: dice.whole(0, 2)])
    if dice.chance(0.75):
        part = cut(part, pipe(inner))
    return dress(dice, part, dice.whole(0, 1))


def coupling(dice: Dice) -> Solid:
    """A hub with jaws or castellations on its face, bored, with grub screws."""
    radius, height = dice.between(10, 30), dice.between(8, 30)
    corners = [Corner(0, 0), Corner(radius, 0, *_trim(dice, 0.2 * radius)), Corner(radius, height), Corner(0, height)]
    tools = [bore(dice, radius * dice.between(0.25, 0.5), height, True).moved(Location((0, 0, height)))]
    count = dice.whole(2, 6)
    wide = radius * sin(pi / count) * dice.between(0.3, 0.7)
    tools += around(count, box((0, -wide, height * dice.between(0.5, 0.85)), (2 * radius, wide, 2 * height)))
    if dice.chance(0.4):
        screw = bore(dice, 0.12 * min(radius, height), radius, True)
        side = Plane((radius, 0, 0.25 * height), x_dir=(0, 1, 0), z_dir=(1, 0, 0))
        tools += around(dice.whole(1, 3), screw.moved(Location(side)))
    return largest(cut(revolve(outline(corners)), tools).wrapped)
