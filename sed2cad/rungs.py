"""The rungs of the ladder of exact solids, and what is traced for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Mesh, Scan
from sed2cad.topology.model import Topology
from sed2cad.topology.proxy import smooth_proxy
from sed2cad.topology.trace import Traced, trace
from sed2cad.topology.walls import walled

UNREGULARISED = "exact, not regularised"


@dataclass(frozen=True)
class Rung:
    """One way to trace and assemble the same patches."""

    name: str
    smoothness: float = 1.0  # of the labels on the proxy mesh
    regular: bool = True  # whether parallel, coaxial, ... are made exact
    smooth: bool = False  # whether the proxy is a Poisson surface instead of a carved one
    walls: bool = True  # whether steps get the walls that the labels lost; without, only where there are such steps

    @property
    def key(self) -> tuple[bool, float]:
        """Rungs with the same one are traced alike."""
        return self.smooth, self.smoothness


LADDER = (
    Rung("exact"),
    Rung(UNREGULARISED, regular=False),
    Rung("exact, smoother borders", smoothness=2.5),
    Rung("exact, smoother borders, no walls added", smoothness=2.5, walls=False),
    Rung("exact, second proxy", smooth=True),
)
RAW_LADDER = (
    Rung(UNREGULARISED, regular=False),
    Rung("exact, not regularised, smoother borders", smoothness=2.5, regular=False),
    Rung("exact, not regularised, second proxy", smooth=True, regular=False),
)


@dataclass
class Tracer:
    """Traces the patches for one rung after another; nothing is made twice."""

    scan: Scan
    fitted: Sequence[FittedPatch]
    proxies: dict[bool, Mesh] = field(default_factory=dict)  # by Rung.smooth
    traces: dict[tuple[bool, float], Traced] = field(default_factory=dict)  # by Rung.key
    with_walls: dict[tuple[bool, float], tuple[Topology, list[FittedPatch]]] = field(default_factory=dict)

    def trace(self, rung: Rung) -> Traced:
        """The topology for a rung. AssemblyError when there is none."""
        if rung.key not in self.traces:
            if rung.smooth and rung.smooth not in self.proxies:
                self.proxies[rung.smooth] = smooth_proxy(self.scan, self.fitted)
            self.traces[rung.key] = trace(self.scan, self.fitted, rung.smoothness, self.proxies.get(rung.smooth))
            self.proxies[rung.smooth] = self.traces[rung.key].proxy
        return self.traces[rung.key]

    def walled(self, rung: Rung) -> tuple[Topology, list[FittedPatch]]:
        """The topology for a rung and its patches, with walls if it asks for them. AssemblyError."""
        traced = self.trace(rung)
        if not rung.walls:
            return traced.topology, traced.fitted
        if rung.key not in self.with_walls:
            self.with_walls[rung.key] = walled(self.scan, traced.topology, traced.fitted)
        return self.with_walls[rung.key]

    def has_steps(self, rung: Rung) -> bool:
        """Whether walls would change the topology. AssemblyError when there is none."""
        return self.walled(replace(rung, walls=True))[0] is not self.trace(rung).topology
