"""A doubled chain leaves the topology closed."""

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
