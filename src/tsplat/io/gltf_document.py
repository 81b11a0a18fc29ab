"""A glTF file opened: its JSON, and where the bytes of its buffers lie.

They are in a chunk of the GLB, in a file beside it, or in the JSON itself as base64; nothing outside of the folder
is opened whatever a URI says. Source: the glTF 2.0 specification, sections 3.6.1 and 4.4.
"""

from __future__ import annotations

import binascii
import io
import os
import re
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote

from tsplat.errors import CorruptFileError, LoadError, shown
from tsplat.io.json_text import parse_json
from tsplat.io.sog_files import is_inside
from tsplat.io.sog_json import JSON_BYTES, Fields

MAGIC = b"glTF"
HEADER = struct.Struct("<4sII")
CHUNK = struct.Struct("<I4s")

HEAD_BYTES = 64
"""Of a file, looked at before all of it is read."""

SIZE_MAX = 1 << 53
"""Larger numbers are not exact in the JSON of other programs."""

ITEMS_MAX = 100_000
"""Nodes, meshes or primitives; each takes a hundred times its bytes once it is looked at."""

_BASE64 = re.compile(rb'"data:[^"\\,]{0,99};base64,([^"\\]*)"')


@dataclass(frozen=True, slots=True)
class Stretch:
    """Bytes that lie together.

    Attributes
    ----------
    source : Path or bytes
        The file, or what is in memory already.
    start, size : int
        In bytes.
    """

    source: Path | bytes
    start: int
    size: int

    def part(self, offset: int, size: int) -> Stretch:
        """Return a part of these bytes, which must reach that far."""
        return Stretch(self.source, self.start + offset, size)

    def open(self) -> BinaryIO:
        """Return a file that stands at the first of these bytes."""
        file = io.BytesIO(self.source) if isinstance(self.source, bytes) else self.source.open("rb")
        file.seek(self.start)
        return file

    def read(self) -> bytes:
        """Return the bytes, fewer if the file has shrunk."""
        with self.open() as file:
            return file.read(self.size)


@dataclass(frozen=True, slots=True)
class Document:
    """What a file says, and its bytes.

    Attributes
    ----------
    path : Path
        The file.
    root : Fields
        Its JSON.
    chunk : Stretch, optional
        The binary chunk of a GLB.
    embedded : list of bytes
        What the JSON held as base64, by the number that stands in its place.
    """

    path: Path
    root: Fields
    chunk: Stretch | None
    embedded: list[bytes]
    _buffers: dict[int, Stretch] = field(default_factory=dict)

    @property
    def stored_bytes(self) -> int:
        """How many bytes there are in all buffers that were looked at, those of one file counted once."""
        return sum({stretch.source: stretch.size for stretch in self._buffers.values()}.values())

    def linked(self, owner: Fields, name: str, listing: str) -> Fields:
        """Return the object of a list at the top of the file that a field names by its index."""
        index, listed = owner.values.get(name), self.root.values.get(listing)
        objects = listed if isinstance(listed, list) else []
        if type(index) is not int or not 0 <= index < len(objects) or not isinstance(objects[index], dict):
            raise owner.wrong(name, f"the index of one of {len(objects)} {listing}")
        return Fields(self.root.corrupt, objects[index], f"{listing}[{index}].")

    def stretch(self, owner: Fields) -> Stretch:
        """Return the bytes of the buffer view that an object names.

        Raises
        ------
        CorruptFileError
            It is not there, or reaches beyond its buffer.
        LoadError
            It is packed.
        """
        view = self.linked(owner, "bufferView", "bufferViews")
        for name in view.inner("extensions").values if view.has("extensions") else ():
            if "meshopt" in name:
                raise self.packed(name)
        buffer = self._buffer(view)
        offset = view.count("byteOffset", 0, buffer.size) if view.has("byteOffset") else 0
        return buffer.part(offset, view.count("byteLength", 0, buffer.size - offset))

    def packed(self, extension: str) -> LoadError:
        """Return the error for bytes that only an extension can unpack."""
        return LoadError(self.path, f"is packed with {shown(extension)[1:-1]}, not read here; unpack it first")

    def _buffer(self, view: Fields) -> Stretch:
        fields, index = self.linked(view, "buffer", "buffers"), view.values["buffer"]
        if index not in self._buffers:
            found = self._find(fields, index)
            self._buffers[index] = found.part(0, fields.count("byteLength", 0, found.size))
        return self._buffers[index]

    def _find(self, fields: Fields, index: int) -> Stretch:
        uri = fields.values.get("uri")
        if uri is None and index == 0 and self.chunk is not None:
            return self.chunk
        if isinstance(uri, str) and (number := re.fullmatch(r"data:(\d{1,9})", uri)):
            if int(number[1]) < len(self.embedded):
                content = self.embedded[int(number[1])]
                return Stretch(content, 0, len(content))
        elif isinstance(uri, str) and is_inside(name := unquote(uri)):
            path = self.path.parent / name
            # Pipes and devices would keep a reader waiting.
            if not path.is_file():
                raise fields.wrong("uri", "a file beside this one")
            return Stretch(path, 0, path.stat().st_size)
        raise fields.wrong("uri", "the name of a file inside the folder, or base64 after 'data:'")


def items(fields: Fields, name: str) -> list[Fields]:
    """Return the objects of a list; none where the field is missing."""
    values = fields.values.get(name, [])
    if not isinstance(values, list) or not all(isinstance(each, dict) for each in values):
        raise fields.wrong(name, "a list of objects")
    if len(values) > ITEMS_MAX:
        raise fields.corrupt(f"has {len(values)} {fields.where}{name}, expected at most {ITEMS_MAX}")
    return [Fields(fields.corrupt, each, f"{fields.where}{name}[{index}].") for index, each in enumerate(values)]


def open_document(path: Path) -> Document:
    """Return the JSON of a GLB or a .gltf.

    Raises
    ------
    CorruptFileError
        It is neither, ends early, or its JSON is too large or none.
    LoadError
        It is of another version.
    """
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        begin = head.removeprefix(b"\xef\xbb\xbf").lstrip()
        if begin and not begin.startswith((MAGIC, b"{")):
            problem = f"begins with {head[:12]!r}, expected {MAGIC!r} or a JSON object; fetch it again"
            raise CorruptFileError(path, problem, 0)
        text, chunk = _read_glb(path, file) if head.startswith(MAGIC) else (path.read_bytes(), None)
    embedded: list[bytes] = []

    def cut_out(found: re.Match[bytes]) -> bytes:
        try:
            embedded.append(binascii.a2b_base64(memoryview(text)[slice(*found.span(1))]))
        except binascii.Error as error:
            problem = "a data URI is no base64, expected whole groups of four; fetch it again"
            raise CorruptFileError(path, problem, found.start(1)) from error
        return b'"data:%d"' % (len(embedded) - 1)

    short = _BASE64.sub(cut_out, text).rstrip(b"\0")  # some writers fill up the chunk with it
    if len(short) > JSON_BYTES:
        raise CorruptFileError(path, f"holds {len(short)} bytes of JSON, expected at most {JSON_BYTES}; split it")
    values = parse_json(
        short, dict, "an object of a glTF", lambda problem, _: CorruptFileError(path, f"{problem}; fetch it again")
    )
    root = Fields(lambda problem: CorruptFileError(path, f"{problem}; fetch it again"), values)
    return Document(path, root, chunk, embedded)


def _read_glb(path: Path, file: BinaryIO) -> tuple[bytes, Stretch | None]:
    file.seek(0)
    head = file.read(HEADER.size)
    if len(head) < HEADER.size:
        raise CorruptFileError(path, f"ends in a header of {HEADER.size} bytes; fetch it again", len(head))
    _, version, length = HEADER.unpack(head)
    if version != 2:
        raise LoadError(path, f"is a GLB of version {version}, expected 2; convert it first", 4)
    size = os.fstat(file.fileno()).st_size
    if length > size:
        raise CorruptFileError(path, f"length: {length} bytes, {size} are there; fetch it again", 8)
    kind, start, span = _chunk(path, file, HEADER.size, length)
    if kind != b"JSON":
        raise CorruptFileError(path, f"first chunk is {kind!r}, expected b'JSON'; fetch it again", HEADER.size + 4)
    text = file.read(span)
    if length - start - span < CHUNK.size:
        return text, None
    kind, start, span = _chunk(path, file, start + span, length)
    return text, Stretch(path, start, span) if kind == b"BIN\0" else None


def _chunk(path: Path, file: BinaryIO, offset: int, length: int) -> tuple[bytes, int, int]:
    """Return the kind of a chunk, where its bytes begin, and how many they are."""
    start = offset + CHUNK.size
    if start > length:
        raise CorruptFileError(path, "ends in the head of a chunk; fetch it again", length)
    file.seek(offset)
    head = file.read(CHUNK.size)
    span, kind = CHUNK.unpack(head) if len(head) == CHUNK.size else (length, b"")
    if span > length - start:
        problem = f"chunk {kind!r} has {span} bytes, {length - start} are there; fetch it again"
        raise CorruptFileError(path, problem, offset)
    return kind, start, span
