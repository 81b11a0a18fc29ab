"""A reader of asciicasts that shares nothing with their writer, and a screen to play them on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import pyte


@dataclass(frozen=True)
class Event:
    """One event, with the time since the start."""

    seconds: float
    kind: str
    text: str


def read_cast(content: bytes) -> tuple[dict[str, Any], list[Event]]:
    """Return the header and the events of an asciicast v3; what is not one fails."""
    first, *lines = content.decode("utf-8").removesuffix("\n").split("\n")
    header = json.loads(first)
    assert header["version"] == 3
    assert all(isinstance(header["term"][side], int) for side in ("cols", "rows"))
    events, seconds = [], 0.0
    for line in lines:
        interval, kind, text = json.loads(line)
        assert interval >= 0.0
        assert kind in ("o", "r", "x")
        seconds += interval
        events.append(Event(round(seconds, 6), kind, text))
    return header, events


def screen_of(header: dict[str, Any], events: list[Event]) -> pyte.Screen:
    """Return what a terminal shows after these events."""
    screen = pyte.Screen(header["term"]["cols"], header["term"]["rows"])
    stream = pyte.Stream(screen)
    for event in events:
        if event.kind == "r":
            columns, rows = map(int, event.text.split("x"))
            screen.resize(rows, columns)
        elif event.kind == "o":
            stream.feed(event.text)
    return screen
