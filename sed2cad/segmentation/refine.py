"""Segmentation: the proposals of the network, refined by the primitives they lead to.

    propose clusters -> fit -> label (energy) -> refit, drop, merge, split, propose where nothing explains -> ...
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from sed2cad.brep.beside import run_each
from sed2cad.segmentation.choose import Case, Choice, choose
from sed2cad.segmentation.corners import Corners
from sed2cad.segmentation.energy import UNEXPLAINED, Tolerances, data_cost, mean_field, reach
from sed2cad.segmentation.graph import Graph
from sed2cad.segmentation.strips import along_strips, bridged, groups, strip_pairs

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

Key = tuple[int, int, int]

FEWEST = 4  # points that make a patch
FEW = 30  # points of a face so small that its neighbours do not look smooth
SMOOTH = 0.2  # weight of the pairs in a smooth piece, at least
RING = 4.0  # spacings that points which nothing explains may be away from the patch that they join


@dataclass(frozen=True)
class State:
    """Labels (n,) and the primitive of each label."""

    labels: Labels
    primitives: tuple[Choice, ...]

    def compact(self) -> State:
        """Without the primitives that no point is labelled with."""
        used, labels = np.unique(self.labels[self.labels >= 0], return_inverse=True)
        out = np.full(len(self.labels), UNEXPLAINED)
        out[self.labels >= 0] = labels
        return State(out, tuple(self.primitives[k] for k in used))


class Refiner:
    """Holds what does not change between the rounds: points, normals, graph, prices."""

    def __init__(
        self,
        points: Array,
        normals: Array,
        graph: Graph,
        tolerances: Tolerances,
        freeform: Array | None = None,
        corners: Corners | None = None,
        fewest: int = FEWEST,
    ) -> None:
        """freeform (n,): probability of each point to lie on a surface that is none of the analytic kinds; fewest
        points that make a patch."""
        self.fewest = fewest
        self.corners = corners
        self.freeform = np.zeros(len(points)) if freeform is None else freeform
        self.points, self.normals, self.graph, self.tolerances = points, normals, graph, tolerances
        self.adjacency: csr_matrix = graph.adjacency()
        self.beside: csr_matrix = graph.adjacency(graph.lengths(points) < RING * graph.spacing)
        self.chosen: dict[Key, Choice | None] = {}  # what sets of points have chosen before
        self.apart: set[tuple[Key, Key]] = set()  # pairs of patches that did not want to be one
        self.near = cKDTree(points).query_pairs(2.5 * graph.spacing, output_type="ndarray")

    def run(self, proposals: list[Labels], rounds: int = 6) -> State:
        """Refine until nothing moves; every proposal (n,) contributes its clusters as candidates."""
        return self.improve(self.start(proposals), rounds)

    def improve(self, state: State, rounds: int) -> State:
        """Refine given patches."""
        for _ in range(rounds):
            before = state.labels
            state = self.relabel(state)
            state = self.flatten(state)
            state = self.split(state)
            state = self.refit(state)
            state = self.propose_unexplained(state)
            state = self.merge(state)
            if np.mean(before != state.labels) < 1e-3 and len(before) == len(state.labels):
                break
        return self.relabel(state, final=True)

    # the steps -------------------------------------------------------------------------------------------

    def start(self, proposals: list[Labels]) -> State:
        """First labels: every point takes the proposed cluster that explains it best."""
        labels = np.full(self.graph.size, UNEXPLAINED)
        least = np.full(self.graph.size, self.tolerances.cap)
        primitives: list[Choice] = []
        self._choose_ahead(members for clusters in proposals for members in groups(clusters))
        for clusters in proposals:
            for members in groups(clusters):
                found = self._choose(members)
                if found is None:
                    continue
                cost = self._data_cost(found, members)
                better = cost < least[members]
                least[members[better]] = cost[better]
                labels[members[better]] = len(primitives)
                primitives.append(found)
        return State(labels, tuple(primitives)).compact()

    def relabel(self, state: State, final: bool = False) -> State:
        """Minimise the energy over the labels, then drop primitives that do not pay for themselves."""
        cost = self._cost(state)
        price = 1.5 if final else 0.6  # of leaving a point unexplained; at first cheap, so that gaps show
        unexplained = np.full((self.graph.size, 1), price * self.tolerances.cap)
        allowed = reach(state.labels, cost, self.adjacency, self.beside, self.tolerances.cap)
        explained = cost < 0.5 * self.tolerances.cap
        allowed |= along_strips(self.points, self.graph.spacing, state.labels, explained)
        full = np.hstack([np.where(allowed, cost, np.inf), unexplained])
        full = self._drop(full)
        labels = mean_field(full, self.adjacency, self.tolerances.smoothness)
        labels = np.where(labels == len(state.primitives), UNEXPLAINED, labels)
        return State(labels, state.primitives).compact()

    def _drop(self, full: Array) -> Array:
        """Close the columns of primitives whose points have nearly as good an explanation elsewhere."""
        full = full.copy()
        best = full.argmin(axis=1)
        for column in np.argsort(np.bincount(best, minlength=full.shape[1])[:-1], kind="stable"):
            mine = np.flatnonzero(best == column)
            held = full[mine, column]
            rest = full[mine]
            rest[:, column] = np.inf
            if len(mine) < self.fewest or (rest.min(axis=1) - held).sum() < self.tolerances.primitive:
                full[:, column] = np.inf
                best[mine] = rest.argmin(axis=1)
        return full

    def flatten(self, state: State) -> State:
        """Facets of a mesh that are sure to be planes become patches of their own where that saves enough."""
        labels, primitives = state.labels.copy(), list(state.primitives)
        for members in groups(self.corners.facets) if self.corners is not None else []:
            own = labels[members]
            costs = [self._data_cost(primitives[k], members[own == k]).sum() for k in np.unique(own[own >= 0])]
            now = self.tolerances.cap * (own < 0).sum() + sum(costs)
            found = self._choose(members) if now > self.tolerances.primitive else None
            if found is not None and now - self._data_cost(found, members).sum() > self.tolerances.primitive:
                labels[members] = len(primitives)
                primitives.append(found)
        return State(labels, tuple(primitives)).compact()

    def split(self, state: State) -> State:
        """Each connected piece of a patch becomes a patch of its own; crumbs lose their label."""
        i, j = self.graph.pairs.T
        pieces = bridged(self.points, state.labels, self.graph.components(state.labels[i] == state.labels[j]))
        size = np.bincount(pieces)
        keep = (size[pieces] >= self.fewest) & (state.labels >= 0)
        labels = np.unique(pieces[keep], return_inverse=True)[1]
        first = state.labels[keep][np.unique(labels, return_index=True)[1]]
        out = np.full(self.graph.size, UNEXPLAINED)
        out[keep] = labels
        return State(out, tuple(state.primitives[k] for k in first))

    def refit(self, state: State) -> State:
        """Every patch chooses its kind again and fits it."""
        self._choose_ahead(groups(state.labels))
        fitted = [self._choose(m) or p for m, p in zip(groups(state.labels), state.primitives)]
        return replace(state, primitives=tuple(fitted))

    def propose_unexplained(self, state: State) -> State:
        """New patches among the points that no primitive explains, best first, while they pay for themselves.

        First in smooth pieces; then in small sets that hang together at all: there are creases between the few points
        of a narrow bore.
        """
        i, j = self.graph.pairs.T
        labels, primitives = state.labels.copy(), list(state.primitives)
        for least, most in ((SMOOTH, len(labels)), (0.0, FEW)):
            free = labels == UNEXPLAINED
            pieces = self.graph.components(free[i] & free[j] & (self.graph.weights > least))
            sets = [own for own in groups(np.where(free, pieces, UNEXPLAINED)) if self.fewest <= len(own) <= most]
            self._choose_ahead(sample for members in sets for sample in self._samples(members))
            for members in sets:
                for found, held in self._explain(members):
                    labels[held] = len(primitives)
                    primitives.append(found)
        return State(labels, tuple(primitives))

    def _explain(self, members: NDArray[np.int64]) -> list[tuple[Choice, NDArray[np.int64]]]:
        """Primitives for a connected set of points, greedily: local fits compete by the cost that they save
        (a RANSAC whose samples are neighbourhoods, after Schnabel et al. 2007)."""
        out: list[tuple[Choice, NDArray[np.int64]]] = []
        while len(members) >= self.fewest and len(out) < 12:
            best_gain, best = 0.0, None
            samples = self._samples(members)
            self._choose_ahead(samples)
            for sample in samples:
                found = self._choose(sample)
                if found is None:
                    continue
                cost = self._data_cost(found, members)
                held = cost < 0.5 * self.tolerances.cap
                gain = (self.tolerances.cap - cost[held]).sum() - self.tolerances.primitive
                if held.sum() >= self.fewest and gain > best_gain:
                    best_gain, best = gain, (found, held)
            if best is None:
                break
            out.append((best[0], members[best[1]]))
            members = members[~best[1]]
        return out

    def _samples(self, members: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """The set itself, and neighbourhoods of three sizes around a few of its points."""
        samples = [members]
        place = self.graph.place[members]
        seeds = np.linspace(0, len(members) - 1, min(8, 1 + len(members) // 12)).astype(int)
        tree = cKDTree(place)
        for size in (8, 16, 40):
            if self.fewest <= size < len(members):
                samples += list(members[np.atleast_2d(tree.query(place[seeds], k=size)[1])])
        return samples

    def merge(self, state: State) -> State:
        """Join neighbouring patches that one primitive explains as well as two."""
        labels, primitives = state.labels.copy(), list(state.primitives)
        alias = np.arange(len(primitives))
        costs: dict[int, float] = {}  # of the patches' points
        pairs, patches = self._near_pairs(state), groups(labels)
        self._choose_ahead(
            np.r_[patches[a], patches[b]]
            for a, b in pairs
            if (_key(patches[a]), _key(patches[b])) not in self.apart
        )
        for a, b in pairs:
            a, b = int(alias[a]), int(alias[b])
            if a == b:
                continue
            of_a, of_b = np.flatnonzero(labels == a), np.flatnonzero(labels == b)
            pair = (_key(of_a), _key(of_b))
            if pair in self.apart:
                continue
            joint = self._choose(np.r_[of_a, of_b])
            if joint is None:
                self.apart.add(pair)
                continue
            for k, own in ((a, of_a), (b, of_b)):
                costs[k] = costs[k] if k in costs else float(self._data_cost(primitives[k], own).sum())
            cost = float(self._data_cost(joint, np.r_[of_a, of_b]).sum())
            together = cost + max(joint.price - primitives[a].price - primitives[b].price, 0.0)
            if together > costs[a] + costs[b] + min(self.tolerances.primitive, float(min(len(of_a), len(of_b)))):
                self.apart.add(pair)
            else:
                labels[labels == b] = a
                alias[alias == b] = a
                primitives[a], costs[a] = joint, cost
        return State(labels, tuple(primitives)).compact()

    # helpers ---------------------------------------------------------------------------------------------

    def _choose(self, members: NDArray[np.int64]) -> Choice | None:
        if len(members) < self.fewest:
            return None
        key = _key(members)
        if key not in self.chosen:
            self.chosen[key] = choose(self._case(members))
        return self.chosen[key]

    def _choose_ahead(self, sets: Iterable[NDArray[np.int64]]) -> None:
        """Let sets of points choose, all at once on two cores: `_choose` knows what comes out."""
        new = {_key(members): members for members in sets if len(members) >= self.fewest}
        new = {key: members for key, members in new.items() if key not in self.chosen}
        self.chosen.update(zip(new, run_each(choose, [self._case(members) for members in new.values()])))

    def _case(self, members: NDArray[np.int64]) -> Case:
        points, normals, freeform = self.points[members], self.normals[members], float(self.freeform[members].mean())
        return Case.of(points, normals, self.tolerances, freeform, self._corners(members))

    def _data_cost(self, choice: Choice, members: NDArray[np.int64] | slice) -> Array:
        points, normals = self.points[members], self.normals[members]
        return data_cost(choice.primitive, choice.sign, points, normals, self.tolerances, self._corners(members))

    def _corners(self, members: NDArray[np.int64] | slice) -> Corners | None:
        return None if self.corners is None else self.corners[members]

    def _cost(self, state: State) -> Array:
        """Data cost (n, k). Freeform patches, slow to measure and meaningless far away, only around their points."""
        cost = np.full((self.graph.size, len(state.primitives)), self.tolerances.cap)
        for column, (choice, members) in enumerate(zip(state.primitives, groups(state.labels))):
            near = slice(None) if choice.primitive.freedom else self._around(members)
            cost[near, column] = self._data_cost(choice, near)
        return cost

    def _around(self, members: NDArray[np.int64]) -> NDArray[np.int64]:
        """Points in the box of the members, widened by ten spacings."""
        margin = 10 * self.graph.spacing
        low, high = self.points[members].min(axis=0) - margin, self.points[members].max(axis=0) + margin
        return np.flatnonzero(((self.points > low) & (self.points < high)).all(axis=1))

    def _near_pairs(self, state: State) -> list[tuple[int, int]]:
        """Pairs of patches that come near each other without a crease between, most common first."""
        i, j = np.vstack([self.near, strip_pairs(self.points, self.graph.spacing, state.labels)]).T
        a, b = state.labels[i], state.labels[j]
        across = (a != b) & (a >= 0) & (b >= 0)
        base = len(state.primitives)
        key = np.minimum(a, b)[across] * base + np.maximum(a, b)[across]
        key, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
        cosine = np.einsum("ij,ij->i", self.normals[i[across]], self.normals[j[across]])
        smooth = np.full(len(key), -1.0)
        np.maximum.at(smooth, inverse, cosine)
        chosen = np.flatnonzero(smooth > 0.8)
        order = chosen[np.argsort(-count[chosen], kind="stable")]
        return [(int(key[k] // base), int(key[k] % base)) for k in order]


def _key(members: NDArray[np.int64]) -> Key:
    """Tells sets of points apart, nearly surely."""
    return len(members), int(members[0]), int(members.sum())
