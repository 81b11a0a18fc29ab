"""JSON of a SOG scene: read within limits, and its fields checked one by one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError, shown
from tsplat.io.json_text import parse_json
from tsplat.io.sog_files import Files, is_inside

F64 = npt.NDArray[np.float64]

JSON_BYTES = 1 << 24
"""Larger files are no lists of names and codebooks: this one would be a hundred thousand leaves of a tree."""

META_BYTES = 1 << 18
"""Ten times what the three codebooks of one scene take, and what may be made of a few packed bytes in a zip."""


@dataclass(frozen=True, slots=True)
class Fields:
    """An object in a JSON file, whose fields are read with their types.

    Attributes
    ----------
    corrupt : callable
        Makes the error for a problem with the file.
    values : dict
        The object.
    where : str
        The fields that lead to it, for messages.
    """

    corrupt: Callable[[str], CorruptFileError]
    values: dict[str, Any]
    where: str = ""

    def has(self, name: str) -> bool:
        """Tell whether the field is there and not null."""
        return self.values.get(name) is not None

    def inner(self, name: str) -> Fields:
        """Return an object inside this one."""
        value = self.values.get(name)
        if not isinstance(value, dict):
            raise self.wrong(name, "an object")
        return Fields(self.corrupt, value, f"{self.where}{name}.")

    def count(self, name: str, low: int, high: int) -> int:
        """Return a whole number within limits."""
        value = self.values.get(name)
        if type(value) is not int or not low <= value <= high:
            raise self.wrong(name, f"a whole number from {low} to {high}")
        return value

    def names(self, name: str, count: int) -> list[str]:
        """Return that many names of files, each inside the folder."""
        value = self.values.get(name)
        if not isinstance(value, list) or len(value) < count or not all(is_inside(each) for each in value):
            raise self.wrong(name, f"{count} names of files inside the scene's folder")
        return value

    def name(self, name: str) -> str:
        """Return one name of a file inside the folder."""
        value = self.values.get(name)
        if not isinstance(value, str) or not is_inside(value):
            raise self.wrong(name, "the name of a file inside the scene's folder")
        return value

    def numbers(self, name: str, low: int, high: int, *, infinite: bool = False) -> F64:
        """Return a list of so many finite numbers, or infinite ones as well; a lone number is a list of one."""
        value = self.values.get(name)
        numbers = value if isinstance(value, list) else [value]
        expected = f"{low} to {high} finite numbers" if low < high else f"{low} finite numbers"
        if not low <= len(numbers) <= high or not all(type(each) in (int, float) for each in numbers):
            raise self.wrong(name, expected)
        try:
            array = np.array(numbers, np.float64)
        except OverflowError as error:
            raise self.wrong(name, expected) from error
        if not (~np.isnan(array) if infinite else np.isfinite(array)).all():
            raise self.wrong(name, expected)
        return array

    def wrong(self, name: str, expected: str) -> CorruptFileError:
        """Return the error for a field that is not what it should be."""
        value = f"is {shown(self.values[name])}" if name in self.values else "is missing"
        return self.corrupt(f"field {self.where}{name} {value}, expected {expected}")


def read_fields(files: Files, name: str, most: int = JSON_BYTES) -> Fields:
    """Return the JSON object that a file of at most so many bytes holds.

    Raises
    ------
    CorruptFileError
        It is too large, no JSON, or no object.
    """
    text = files.read(name, most + 1)
    if len(text) > most:
        raise files.corrupt(name, f"holds more than {most} bytes, expected less of a list of planes")
    expected = "an object that lists a scene's planes"
    values = parse_json(text, dict, expected, lambda problem, _: files.corrupt(name, problem))
    return Fields(lambda problem: files.corrupt(name, problem), values)
