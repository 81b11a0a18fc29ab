"""Machine code of kernels: bytes that can be kept, and functions that run it. Nothing here needs Numba.

An object file, as compilers write it, is linked into this process by LLVM. Its entry takes the address of the
arguments, as `tsplat._arguments` packs them, and of a place for the result; it returns 0 unless the kernel raised.
"""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numpy as np

from tsplat import locks
from tsplat._arguments import ENTRY_TYPE

ENTRY = "tsplat_entry"

RESULTS: dict[str, tuple[Any, Callable[[Any], Any]]] = {
    "nothing": (ctypes.c_int64, lambda _: None),
    "bool": (ctypes.c_int64, bool),
    "int": (ctypes.c_int64, int),
    "unsigned": (ctypes.c_uint64, np.uint64),
    "float": (ctypes.c_double, float),
}
"""What a kernel may return: how it leaves it, and what Python gets."""

BEYOND = "a kernel looked beyond the end of an array"
"""What an entry says by any number but 0."""

MAGIC = b"tsplat machine code\n"
HEADER_BYTES = len(MAGIC) + 8 + 32
"""The magic bytes, the length of what follows, and its SHA-256 together with the name."""

_engines: list[llvm.ExecutionEngine] = []
"""What holds machine code: as long as the process lives, for a thread may be running it when all else ends."""

_lock = locks.lock()
locks.let_forks_wait(_lock)


class MachineCode(NamedTuple):
    """An object file, and which of `RESULTS` its entry leaves."""

    result: str
    object_file: bytes


def to_bytes(code: MachineCode, name: str) -> bytes:
    """Return machine code as bytes that say whether they are whole, and whether they were kept under this name."""
    body = code.result.encode() + b"\n" + code.object_file
    return MAGIC + len(body).to_bytes(8, "little") + _digest(name, body) + body


def from_bytes(kept: bytes, name: str) -> MachineCode | None:
    """Return what `to_bytes` made bytes of; None where that were others, or another name, or no object file.

    It tells what was damaged or mixed up. Who writes a file on purpose can have anything run: see `own_files`.
    """
    body = kept[HEADER_BYTES:]
    if kept[:HEADER_BYTES] != MAGIC + len(body).to_bytes(8, "little") + _digest(name, body):
        return None
    word, _, object_file = body.partition(b"\n")
    result = word.decode(errors="replace")
    # LLVM ends the process where it is told to link anything else.
    known = result in RESULTS and ENTRY.encode() in object_file
    if not known or not llvm.ObjectFileRef.from_data(object_file):
        return None
    return MachineCode(result, object_file)


def _digest(name: str, body: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\n" + body).digest()


class Linked(NamedTuple):
    """Machine code that can run: by the address of its entry, or as a function of packed arguments."""

    entry: int
    run: Callable[[bytes], Any]
    """It lets go of the interpreter lock."""


def linked(code: MachineCode) -> Linked:
    """Return machine code as part of this process."""
    with _lock:  # LLVM's linker is not made for several threads
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        # What is linked is compiled already, so this knows nothing of the processor but its kind.
        target = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine()
        # An engine for each: the names in two object files may be the same.
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target)
        _engines.append(engine)
        engine.add_object_file(llvm.ObjectFileRef.from_data(code.object_file))
        engine.finalize_object()
        address = engine.get_function_address(ENTRY)
    enter = ENTRY_TYPE(address)
    place_type, result = RESULTS[code.result]

    def run(arguments: bytes) -> Any:
        place = place_type()
        if enter(arguments, ctypes.byref(place)):
            raise IndexError(BEYOND)
        return result(place.value)

    return Linked(address, run)


def assembled(text: str, name: str) -> int:
    """Return the address of a function in LLVM's assembly language, which stays as long as the process lives."""
    with _lock:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        target = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine()
        _engines.append(llvm.create_mcjit_compiler(llvm.parse_assembly(text), target))
        _engines[-1].finalize_object()
        return int(_engines[-1].get_function_address(name))


@lru_cache(maxsize=1)
def processor() -> str:
    """Return what machine code for this processor is not good for others by."""
    return f"{llvm.get_process_triple()} {llvm.get_host_cpu_name()} {llvm.get_host_cpu_features().flatten()}"
