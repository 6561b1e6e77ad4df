"""The rungs of the ladder of exact solids, and what is traced for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Mesh, Scan
from sed2cad.topology.mincut import Labels
from sed2cad.topology.model import Topology
from sed2cad.topology.proxy import smooth_proxy
from sed2cad.topology.thicken import has_thin_walls, traced_thick
from sed2cad.topology.trace import Traced, trace
from sed2cad.topology.walls import walled

Proxy = Literal["carved", "smooth", "thick"]
UNREGULARISED = "exact, not regularised"


@dataclass(frozen=True)
class Rung:
    """One way to trace and assemble the same patches."""

    name: str
    smoothness: float = 1.0  # of the labels on the proxy mesh
    regular: bool = True  # whether parallel, coaxial, ... are made exact
    proxy: Proxy = "carved"  # from the samples, a Poisson surface, or from samples moved outwards for thin walls
    walls: bool = True  # whether steps get the walls that the labels lost; without, only where there are such steps

    @property
    def key(self) -> tuple[Proxy, float]:
        """Rungs with the same one are traced alike."""
        return self.proxy, self.smoothness


LADDER = (
    Rung("exact"),
    Rung("exact, thin walls", proxy="thick"),
    Rung(UNREGULARISED, regular=False),
    Rung("exact, smoother borders", smoothness=2.5),
    Rung("exact, smoother borders, no walls added", smoothness=2.5, walls=False),
    Rung("exact, second proxy", proxy="smooth"),
)
RAW_LADDER = (
    Rung(UNREGULARISED, regular=False),
    Rung("exact, not regularised, thin walls", proxy="thick", regular=False),
    Rung("exact, not regularised, smoother borders", smoothness=2.5, regular=False),
    Rung("exact, not regularised, second proxy", proxy="smooth", regular=False),
)


@dataclass
class Tracer:
    """Traces the patches for one rung after another; nothing is made twice."""

    scan: Scan
    fitted: Sequence[FittedPatch]
    proxies: dict[Proxy, Mesh] = field(default_factory=dict)
    traces: dict[tuple[Proxy, float], Traced] = field(default_factory=dict)  # by Rung.key
    unseen: Labels | None = None  # triangles of the carved proxy on no surface: see `trace`
    with_walls: dict[tuple[Proxy, float], tuple[Topology, list[FittedPatch]]] = field(default_factory=dict)

    @property
    def is_open(self) -> bool:
        """Whether the part is open where nothing was seen."""
        return self.unseen is not None

    def trace(self, rung: Rung) -> Traced:
        """The topology for a rung. AssemblyError when there is none."""
        if rung.key not in self.traces:
            self.traces[rung.key] = self._traced(rung)
            self.proxies[rung.proxy] = self.traces[rung.key].proxy
        return self.traces[rung.key]

    def _traced(self, rung: Rung) -> Traced:
        if rung.proxy == "thick":
            return traced_thick(self.scan, self.fitted, rung.smoothness)
        if rung.proxy == "smooth" and rung.proxy not in self.proxies:
            self.proxies[rung.proxy] = smooth_proxy(self.scan, self.fitted)
        return trace(self.scan, self.fitted, rung.smoothness, self.proxies.get(rung.proxy), self.unseen)

    def walled(self, rung: Rung) -> tuple[Topology, list[FittedPatch]]:
        """The topology for a rung and its patches, with walls if it asks for them. AssemblyError."""
        traced = self.trace(rung)
        if not rung.walls:
            return traced.topology, traced.fitted
        if rung.key not in self.with_walls:
            self.with_walls[rung.key] = walled(self.scan, traced.topology, traced.fitted)
        return self.with_walls[rung.key]

    def applies(self, rung: Rung) -> bool:
        """Whether a rung differs from those before it. AssemblyError when there is no topology."""
        if self.is_open and rung.key != LADDER[0].key:
            return False  # a face to blame is left out instead
        if rung.proxy == "thick":
            return has_thin_walls(self.scan)
        return rung.walls or self.has_steps(rung)

    def has_steps(self, rung: Rung) -> bool:
        """Whether walls would change the topology. AssemblyError when there is none."""
        return self.walled(replace(rung, walls=True))[0] is not self.trace(rung).topology
