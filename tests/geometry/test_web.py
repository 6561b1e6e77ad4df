"""Edits leave the topology closed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sed2cad.geometry.web import Web
from tests.geometry import parts
from tests.topology.test_trace import check_closed


@pytest.mark.parametrize(("name", "loops"), [("box", 1), ("box_with_hole", 2)])
def test_a_doubled_chain_has_a_region_between(name: str, loops: int) -> None:
    topology = parts.EXACT[name]().topology
    k = next(n for n, chain in enumerate(topology.chains) if chain.closed == (loops == 2))
    chain, between = topology.chains[k], replace(topology.regions[0], loops=())
    found = Web(topology).doubled(k, chain.points, chain.points + 1, between).topology()
    check_closed(found)
    own, double = found.chains[k], found.chains[-1]
    assert len(found.regions[-1].loops) == loops
    assert (own.left, own.right, double.right) == (chain.left, double.left, chain.right)
    assert (double.points == chain.points + 1).all()
    assert len(topology.chains) == len(found.chains) - 1 and not topology.chains[k].right == own.right


@pytest.mark.parametrize(("name", "closed"), [("box", False), ("box_with_hole", True)])
def test_a_region_that_was_put_between_becomes_one_with_its_neighbour(name: str, closed: bool) -> None:
    topology = parts.EXACT[name]().topology
    k = next(n for n, chain in enumerate(topology.chains) if chain.closed == closed)
    web = Web(topology).doubled(k, topology.chains[k].points, topology.chains[k].points, topology.regions[0])
    for gone in (k, len(web.chains) - 1):
        found = web.united(gone).topology()
        check_closed(found)
        assert len(found.regions) == len(topology.regions) and len(found.chains) == len(topology.chains)
        assert [len(region.loops) for region in found.regions] == [len(region.loops) for region in topology.regions]
