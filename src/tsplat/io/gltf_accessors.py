"""Accessors of a glTF: numbers of many kinds in a buffer, read as float32 a chunk at a time.

Source: the glTF 2.0 specification, sections 3.6.2 (layout, sparse accessors) and 3.11 (normalised integers).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tsplat.io.gltf_document import SIZE_MAX, Document, Stretch
from tsplat.io.sog_json import Fields

F32 = npt.NDArray[np.float32]

COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
STRIDE_MAX = 252

CHUNK_BYTES = 1 << 19
"""What is read at once, whatever lies between the numbers."""


@dataclass(frozen=True, slots=True)
class Accessor:
    """Rows of numbers that are there, every byte of them.

    Attributes
    ----------
    fields : Fields
        What says so, for messages.
    stretch : Stretch
        From the first row on.
    component : dtype
        Of one number.
    count, width : int
        Rows, and numbers in each.
    stride : int
        Bytes from row to row.
    normalized : bool
        Whether integers stand for -1 to 1, or 0 to 1.
    sparse : pair of Accessor, optional
        Indices of the rows that are replaced, and what stands in their place.
    """

    fields: Fields
    stretch: Stretch
    component: np.dtype[np.generic]
    count: int
    width: int
    stride: int
    normalized: bool
    sparse: tuple[Accessor, Accessor] | None = None

    def read(self, out: F32) -> None:
        """Write the numbers to ``out``, float32 [count, width].

        Raises
        ------
        CorruptFileError
            The file has shrunk, or sparse indices do not ascend within the rows.
        """
        for first, rows in self._chunks():
            out[first : first + len(rows)] = rows
        if self.sparse is not None:
            places, values = self.sparse
            replaced = np.concatenate([rows[:, 0] for _, rows in places._chunks()]).astype(np.int64)
            if (np.diff(replaced, prepend=-1) <= 0).any() or replaced[-1] >= self.count:
                raise places.fields.corrupt(f"{places.fields.where[:-1]} do not ascend within {self.count} rows")
            for first, rows in values._chunks():
                out[replaced[first : first + len(rows)]] = rows
        if self.normalized and self.component.kind in "iu":
            out /= np.iinfo(self.component).max  # type: ignore[type-var]
            np.maximum(out, -1.0, out=out)

    def _chunks(self) -> Iterator[tuple[int, npt.NDArray[np.generic]]]:
        numbers = {"names": ["numbers"], "formats": [(self.component, (self.width,))], "itemsize": self.stride}
        row = np.dtype(numbers)  # type: ignore[call-overload]
        step = max(1, CHUNK_BYTES // self.stride)
        with self.stretch.open() as file:
            for first in range(0, self.count, step):
                n = min(step, self.count - first)
                raw = file.read(n * self.stride)
                if len(raw) < (n - 1) * self.stride + self.component.itemsize * self.width:
                    problem = f"ends in row {first + len(raw) // self.stride} of {self.count}"
                    raise self.fields.corrupt(f"{self.fields.where[:-1]} {problem}")
                # Nothing needs to follow the last row.
                yield first, np.frombuffer(raw.ljust(n * self.stride, b"\0"), row, n)["numbers"]


def find_accessor(document: Document, owner: Fields, name: str, kinds: tuple[str, ...]) -> Accessor:
    """Return the accessor that a field names by its index.

    Parameters
    ----------
    document : Document
        The file.
    owner : Fields
        The object with the field.
    name : str
        The field.
    kinds : tuple of str
        Types that are expected.

    Raises
    ------
    CorruptFileError
        It has not the type, or not the bytes that it needs.
    LoadError
        Its bytes are packed.
    """
    fields = document.linked(owner, name, "accessors")
    if fields.values.get("type") not in kinds:
        raise fields.wrong("type", " or ".join(kinds))
    width, count = WIDTHS[fields.values["type"]], fields.count("count", 0, SIZE_MAX)
    found = _rows(document, fields, _component(fields), count, width)
    if fields.values.get("normalized") is True:
        found = replace(found, normalized=True)
    if not fields.has("sparse"):
        return found
    sparse = fields.inner("sparse")
    indices, values = sparse.inner("indices"), sparse.inner("values")
    replaced, component = sparse.count("count", 1, count), _component(indices)
    if component.kind != "u":
        raise indices.wrong("componentType", "5121, 5123 or 5125")
    places = _rows(document, indices, component, replaced, 1)
    return replace(found, sparse=(places, _rows(document, values, found.component, replaced, width)))


def _component(fields: Fields) -> np.dtype[np.generic]:
    code = fields.values.get("componentType")
    if type(code) is not int or code not in COMPONENTS:
        raise fields.wrong("componentType", f"one of {', '.join(map(str, COMPONENTS))}")
    return np.dtype(COMPONENTS[code])


def _rows(document: Document, fields: Fields, component: np.dtype[np.generic], count: int, width: int) -> Accessor:
    stretch, view = document.stretch(fields), document.linked(fields, "bufferView", "bufferViews")
    size = component.itemsize * width
    stride = view.count("byteStride", size, STRIDE_MAX) if view.has("byteStride") else size
    offset = fields.count("byteOffset", 0, stretch.size) if fields.has("byteOffset") else 0
    need, there = (count - 1) * stride + size if count else 0, stretch.size - offset
    if need > there:
        raise fields.corrupt(f"{fields.where[:-1]} needs {need} bytes for {count} rows, {there} are there")
    return Accessor(fields, stretch.part(offset, there), component, count, width, stride, normalized=False)
