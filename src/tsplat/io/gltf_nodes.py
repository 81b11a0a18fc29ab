"""Which meshes a glTF shows, and where: the tree of its nodes walked from the roots of its scene.

Source: the glTF 2.0 specification, section 3.5.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from tsplat.io.gltf_document import Document, items
from tsplat.io.sog_json import Fields

F64 = npt.NDArray[np.float64]


def placed_meshes(document: Document) -> list[tuple[Fields, F64]]:
    """Return the meshes in the order of the tree, each with the matrix [4, 4] that places it in the world.

    Those that a scale of zero hides are left out; without any nodes, every mesh stands where it is.

    Raises
    ------
    CorruptFileError
        A node has two parents or is its own ancestor, or a field is not what it should be.
    """
    nodes = items(document.root, "nodes")
    if not nodes:
        return [(mesh, np.eye(4)) for mesh in items(document.root, "meshes")]
    found: list[tuple[Fields, F64]] = []
    seen: set[int] = set()
    waiting = [(index, np.eye(4)) for index in reversed(_roots(document, nodes))]
    while waiting:
        index, parent = waiting.pop()
        if index in seen:
            raise document.root.corrupt(f"nodes[{index}] is reached twice, expected a tree")
        seen.add(index)
        node = nodes[index]
        matrix = parent @ _local(node)
        if not matrix[:3, :3].any():
            continue
        if node.has("mesh"):
            found.append((document.linked(node, "mesh", "meshes"), matrix))
        waiting += [(child, matrix) for child in reversed(_indices(node, "children", len(nodes)))]
    return found


def _roots(document: Document, nodes: list[Fields]) -> list[int]:
    if document.root.has("scenes"):
        chosen: dict[str, Any] = {"scene": document.root.values.get("scene", 0)}
        scene = document.linked(Fields(document.root.corrupt, chosen), "scene", "scenes")
        return _indices(scene, "nodes", len(nodes))
    children = {child for node in nodes for child in _indices(node, "children", len(nodes))}
    return [index for index in range(len(nodes)) if index not in children]


def _indices(fields: Fields, name: str, count: int) -> list[int]:
    values = fields.values.get(name, [])
    if not isinstance(values, list) or not all(type(each) is int and 0 <= each < count for each in values):
        raise fields.wrong(name, f"indices of the {count} nodes")
    return values


def _local(node: Fields) -> F64:
    """Return the matrix of a node, [4, 4]: its own, or of a scale, then a rotation, then a translation."""
    if node.has("matrix"):
        return node.numbers("matrix", 16, 16).reshape(4, 4).T
    matrix = np.eye(4)
    if node.has("rotation"):
        x, y, z, w = quat = node.numbers("rotation", 4, 4)
        if not 0.0 < quat @ quat < np.inf:
            raise node.wrong("rotation", "a quaternion of length 1")
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        matrix[:3, :3] += 2.0 / (quat @ quat) * (w * cross + cross @ cross)
    if node.has("scale"):
        matrix[:3, :3] *= node.numbers("scale", 3, 3)
    if node.has("translation"):
        matrix[:3, 3] = node.numbers("translation", 3, 3)
    return matrix
