"""The command line's own kinds of arguments: scenes, numbers, and a command that need not be named."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import rich_click as click

from tsplat import numerals

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


class Whole(click.IntRange):
    """A whole number within a range."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return an int."""
        if isinstance(value, str) and numerals.whole(value) is None:
            self.fail(f"{value!r} is not a whole number of at most 12 digits", param, ctx)
        return super().convert(value, param, ctx)


class Number(click.FloatRange):
    """A finite number within a range: nan compares with nothing, so a range alone lets it pass."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a float."""
        if isinstance(value, str) and numerals.finite(value) is None:
            self.fail(f"{value!r} is not a number from -3.4e38 to 3.4e38", param, ctx)
        return super().convert(value, param, ctx)


class Gigabytes(Number):
    """So many times 10^9 bytes."""

    name = "gigabytes"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a whole number of bytes."""
        return round(1e9 * super().convert(value, param, ctx))


class Numbers(click.ParamType):  # type: ignore[type-arg]
    """So many finite numbers with commas or spaces between them; ``otherwise`` where none need to be given."""

    def __init__(self, name: str, count: int, expected: str, otherwise: tuple[float, ...] | None = None) -> None:
        self.name, self.count, self.expected, self.otherwise = name, count, expected, otherwise

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a tuple of floats."""
        if isinstance(value, tuple):
            return value
        numbers = [numerals.finite(word) for word in value.replace(",", " ").split()]
        if len(numbers) != self.count or None in numbers:
            self.fail(f"{value!r} is not {self.expected}", param, ctx)
        return tuple(numbers)


class Triple(Numbers):
    """Three of them, or a name that stands for them."""

    def __init__(self, name: str, expected: str, names: dict[str, tuple[float, float, float]]) -> None:
        super().__init__(name, 3, expected)
        self.names = names

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a tuple of three floats."""
        if isinstance(value, str) and value.lower() in self.names:
            return self.names[value.lower()]
        if self.name == "color" and isinstance(value, str) and re.fullmatch("#[0-9a-fA-F]{6}", value):
            return tuple(int(value[start : start + 2], 16) / 255.0 for start in (1, 3, 5))
        return super().convert(value, param, ctx)


POINT = Triple("point", "three numbers X Y Z", {})
UP = Triple("axis", "x, y, z, -x, -y, -z or three numbers X Y Z", AXES)
BACKGROUND = Triple("color", "black, white, grey, #rrggbb or three numbers R G B from 0 to 1", COLORS)


class Level(click.ParamType):  # type: ignore[type-arg]
    """A level of detail, or all of them, which is None."""

    name = "level"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return an int, or None."""
        if isinstance(value, str) and not re.fullmatch(r"[0-9]{1,4}|all", value):
            self.fail(f"{value!r} is not a level of detail, 0 or more, or all", param, ctx)
        return None if value == "all" else int(value)


LEVEL = Level()


class Triples(click.RichCommand):
    """A command whose options of kind `Numbers`, mostly three, also take them as arguments of their own."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Join ``--eye 1 2 3`` to ``--eye=1,2,3``, then parse as usual."""
        return super().parse_args(ctx, self.joined(args))

    def joined(self, args: list[str]) -> list[str]:
        """Return the arguments with such options and their numbers as one."""
        kinds = {name: param.type for param in self.params for name in param.opts}
        known = {name: kind for name, kind in kinds.items() if isinstance(kind, Numbers)}
        joined: list[str] = []
        while args:
            word, *args = args
            if kind := known.get(word):
                count = kind.count
                if len(args) >= count and None not in map(numerals.finite, args[:count]):
                    word, args = f"{word}={','.join(args[:count])}", args[count:]
                elif kind.otherwise is not None:
                    word = f"{word}={','.join(map(str, kind.otherwise))}"
                elif args:
                    word, args = f"{word}={args[0]}", args[1:]
            joined.append(word)
        return joined


class InOrder(Triples):
    """A command that knows in which order its options were given."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Keep the names of the options as ``ctx.obj``, one for each time it was given; then parse as usual."""
        joined = self.joined(args)
        *_, given = self.make_parser(ctx).parse_args(args=list(joined))
        ctx.obj = [param.name for param in given]
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
