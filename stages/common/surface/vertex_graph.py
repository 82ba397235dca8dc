"""The vertices of a mesh and the edges between them."""

from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from texloom.stages.common.surface.mesh import at_vertices, tangential, vertex_normals, vertices
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.vocabulary.arrays import Mesh

_MIN_AGREEING = 1e-6  # product of neighbouring lines below which neither tells the sense of the other


class VertexGraph:
    """Neighbours, normals and curvature at the vertices.

    Parameters
    ----------
    mesh : with unit normals; corners at the same place are one vertex.
    """

    def __init__(self, mesh: Mesh):
        self.vertex = vertices(mesh)
        """of each corner"""
        self.corners = np.bincount(self.vertex)
        """how many a vertex has"""
        self.points = self.means(mesh[:, :3].astype(np.float64))
        self.normal = vertex_normals(mesh, self.vertex)
        self.radius = float(np.linalg.norm(self.points - self.points.mean(axis=0), axis=1).max())
        """of the mesh, world units"""
        corner = self.vertex.reshape(-1, 3)
        self.begin, self.end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
        """the vertices of each edge of each face"""

    def means(self, values: Float[np.ndarray, "corners c"]) -> Float64[np.ndarray, "vertices c"]:
        """Over the corners of each vertex."""
        return at_vertices(self.vertex, values) / self.corners[:, None]

    def at_corners(self, values: Float64[np.ndarray, "vertices ..."]) -> Float64[np.ndarray, "corners ..."]:
        """Each corner has what its vertex has."""
        return np.asarray(values[self.vertex])

    def smoothed(self, values: Float64[np.ndarray, "vertices c"]) -> Float64[np.ndarray, "vertices c"]:
        """Means over the neighbours of each vertex."""
        return np.asarray(self._graph[0] @ values / self._graph[1])

    @cached_property
    def _graph(self) -> tuple[Any, np.ndarray]:
        sparse = loaded("scipy.sparse")
        count = self.corners.size
        pairs = np.concatenate([self.begin, self.end]), np.concatenate([self.end, self.begin])
        graph = sparse.coo_array((np.ones(2 * self.begin.size), pairs), shape=(count, count)).tocsr()
        return graph, np.maximum(graph.sum(axis=1), 1)[:, None]

    def oriented(
        self, lines: Float64[np.ndarray, "vertices 3"], towards: Float64[np.ndarray, "vertices 3"]
    ) -> Float64[np.ndarray, "vertices 3"]:
        """Lines, zeros where there is none, with the same sense as their neighbours; connected ones ``towards``.

        Senses spread along the spanning tree of the edges whose lines differ least.
        """
        sparse = loaded("scipy.sparse")
        csgraph = loaded("scipy.sparse.csgraph")
        root = len(lines)
        agree = np.einsum("ni,ni->n", lines[self.begin], lines[self.end])
        less, more = np.sort(np.stack([self.begin, self.end])[:, np.abs(agree) > _MIN_AGREEING], axis=0)
        less, more = np.divmod(np.unique(less * root + more), root)
        cost = 1 / np.abs(np.einsum("ni,ni->n", lines[less], lines[more]))
        edges = sparse.coo_array((cost, (less, more)), shape=(root, root)).tocsr()
        part = csgraph.connected_components(edges, directed=False)[1]
        _, first = np.unique(part, return_index=True)
        tree = csgraph.minimum_spanning_tree(edges).tocoo()
        links = np.concatenate([tree.row, first]), np.concatenate([tree.col, np.full(first.size, root)])
        tree = sparse.coo_array((np.ones(links[0].size), links), shape=(root + 1, root + 1)).tocsr()
        parent = csgraph.breadth_first_order(tree, root, directed=False)[1]
        parent[root] = root
        whole = np.concatenate([lines, np.zeros((1, 3))])
        sense = np.where(np.einsum("ni,ni->n", whole, whole[parent]) < 0, -1.0, 1.0)
        while (parent != root).any():  # of each vertex against its ancestors, twice as far up each time
            sense *= sense[parent]
            parent = parent[parent]
        made = lines * sense[:root, None]
        total = np.bincount(part, np.einsum("ni,ni->n", made, towards))
        return np.asarray(made * np.where(total < 0, -1.0, 1.0)[part, None])

    @cached_property
    def _edges(self) -> tuple[Float64[np.ndarray, "edges 3"], Float64[np.ndarray, "*edges"]]:
        """Displacement along the edges, and normal curvature there; ridges are positive."""
        edge = self.points[self.end] - self.points[self.begin]
        bend = np.einsum("ni,ni->n", self.normal[self.end] - self.normal[self.begin], edge)
        return edge, bend / np.maximum(np.einsum("ni,ni->n", edge, edge), 1e-300)

    def mean_curvature(self) -> Float64[np.ndarray, "*vertices"]:
        """Mean of the normal curvatures along the edges."""
        ends = np.concatenate([self.begin, self.end])
        return np.asarray(np.bincount(ends, np.tile(self._edges[1], 2)) / np.bincount(ends))

    def curvature_tensors(self) -> Float64[np.ndarray, "vertices 3 3"]:
        """Means over the edges of normal curvature times the outer product of their directions.

        References
        ----------
        [Taubin1995]_ section 4, with equal weights.
        """
        edge, bend = self._edges
        ends, bend = np.concatenate([self.begin, self.end]), np.tile(bend, 2)
        along = tangential(np.tile(edge, (2, 1)), self.normal[ends])
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
        made = np.empty((self.corners.size, 3, 3))
        for row in range(3):
            for column in range(row, 3):
                total = np.bincount(ends, bend * along[:, row] * along[:, column])
                made[:, row, column] = made[:, column, row] = total / np.bincount(ends)
        return made
