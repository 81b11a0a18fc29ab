"""The command line's own kinds of arguments: scenes, three numbers, and a command that need not be named."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import rich_click as click

DEMO = "demo"
"""What the scene in the package is called."""

AXES = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
COLORS = {"black": (0.0, 0.0, 0.0), "white": (1.0, 1.0, 1.0), "grey": (0.5, 0.5, 0.5)}


def scene_source(scene: str) -> str | Path:
    """Return what to load for the scene that a person named: a URL would not survive being a `Path`."""
    from tsplat.io import demo_path

    return demo_path() if scene == DEMO else scene


def scene_name(scene: str) -> str:
    """Return the scene's name without folders and suffix, fit to be part of a file's name."""
    from tsplat.io.sources import file_name

    return Path(file_name(scene)).stem


class Triple(click.ParamType):  # type: ignore[type-arg]
    """Three finite numbers with commas or spaces between them, or a name that stands for them."""

    def __init__(self, name: str, expected: str, names: dict[str, tuple[float, float, float]]) -> None:
        self.name, self.expected, self.names = name, expected, names

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a tuple of three floats."""
        if isinstance(value, tuple):
            return value
        if value.lower() in self.names:
            return self.names[value.lower()]
        if self.name == "color" and re.fullmatch("#[0-9a-fA-F]{6}", value):
            return tuple(int(value[start : start + 2], 16) / 255.0 for start in (1, 3, 5))
        numbers = [_number(word) for word in value.replace(",", " ").split()]
        if len(numbers) != 3 or None in numbers:
            self.fail(f"{value!r} is not {self.expected}", param, ctx)
        return tuple(numbers)


POINT = Triple("point", "three numbers X Y Z", {})
UP = Triple("axis", "x, y, z, -x, -y, -z or three numbers X Y Z", AXES)
BACKGROUND = Triple("color", "black, white, grey, #rrggbb or three numbers R G B from 0 to 1", COLORS)


class Triples(click.RichCommand):
    """A command whose options of kind `Triple` also take their three numbers as three arguments."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Join ``--eye 1 2 3`` to ``--eye=1,2,3``, then parse as usual."""
        known = {name for param in self.params if isinstance(param.type, Triple) for name in param.opts}
        joined: list[str] = []
        while args:
            word, *args = args
            if word in known and len(args) >= 3 and None not in map(_number, args[:3]):
                word, args = f"{word}={','.join(args[:3])}", args[3:]
            elif word in known and args:
                word, args = f"{word}={args[0]}", args[1:]
            joined.append(word)
        return super().parse_args(ctx, joined)


class ViewByDefault(click.RichGroup):
    """A group where arguments that name no command are those of ``view``."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the commands in the order they were defined, the default one first."""
        return list(self.commands)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put ``view`` before arguments that name no command."""
        own = {name for param in self.get_params(ctx) for name in param.opts}
        if not args or args[0] not in {*self.commands, *own}:
            args = ["view", *args]
        return super().parse_args(ctx, args)


def _number(word: str) -> float | None:
    try:
        number = float(word)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
