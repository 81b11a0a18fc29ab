"""Bytes from the terminal to events.

By hand rather than with blessed: its parser needs a `Terminal` on a real tty, which asks the terminal many
questions in a row, takes 230 ms to import, and spends 305 microseconds on each mouse motion.
Sources: ECMA-48; xterm's ctlseqs; https://sw.kovidgoyal.net/kitty/keyboard-protocol/.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from tsplat.terminal.keys import Answered, Event, Focus, Key, KeyAction, Mouse, MouseAction, MouseButton
from tsplat.terminal.limits import MOST_COLUMNS, MOST_HELD, MOST_KEYS_DOWN, MOST_NUMBER, MOST_ROWS


@dataclass(frozen=True, slots=True)
class PixelReport:
    """The answer to CSI 16t (``kind`` 6, a text cell) or CSI 14t (``kind`` 4, the text area), in pixels."""

    kind: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class SizeReport:
    """The terminal has a new size (mode 2048): text cells, and pixels of the text area, 0 where not said."""

    columns: int
    rows: int
    width: int
    height: int


Reported = Event | PixelReport | SizeReport
Parsed = Reported | None

_ESCAPE = 0x1B
_CSI = re.compile(rb"\x1b\[([<=>?]?)([\d;:]*)[ -/]*([@-Z\\-~])")
_LINUX_F_KEY = re.compile(rb"\x1b\[\[([A-E])")
_SS3 = re.compile(rb"\x1bO([ -~])")
_STRING = re.compile(rb"\x1b[P\]_^X][^\x1b\x07]*(?:\x07|\x1b\\?)")  # DCS, OSC, APC, PM, SOS
_INCOMPLETE = re.compile(rb"\x1b(?:\[\[?|\[[<=>?]?[\d;:]*[ -/]*|[P\]_^X][^\x1b\x07]*\x1b?|O)?\Z")

_STRING_END = re.compile(rb"\x07|\x1b\\?")
_CSI_END = re.compile(rb"[^\d;: -/]")

_LETTERS = {"A": "up", "B": "down", "C": "right", "D": "left", "H": "home", "F": "end"}
_LETTERS |= {"P": "f1", "Q": "f2", "R": "f3", "S": "f4"}
_KEYPAD_LETTERS = {"M": "enter", "j": "*", "k": "+", "l": ",", "m": "-", "n": ".", "o": "/", "X": "="}
_TILDES = {1: "home", 2: "insert", 3: "delete", 4: "end", 5: "pageup", 6: "pagedown", 7: "home", 8: "end"}
_TILDES |= {11: "f1", 12: "f2", 13: "f3", 14: "f4", 15: "f5", 17: "f6", 18: "f7", 19: "f8", 20: "f9"}
_TILDES |= {21: "f10", 23: "f11", 24: "f12"}
_CODES = {8: "backspace", 9: "tab", 10: "enter", 13: "enter", 27: "escape", 32: "space", 127: "backspace"}
# The kitty keyboard has its own numbers for the keypad; those keys do what their namesakes do.
_KEYPAD = (*"0123456789./*-+", "enter", "=", ",", "left", "right", "up", "down", "pageup", "pagedown")
_CODES |= dict(enumerate((*_KEYPAD, "home", "end", "insert", "delete"), start=57399))
_PRIVATE_USE = range(57344, 63744)

_ACTIONS: dict[int, KeyAction] = {2: "repeat", 3: "release"}
_BUTTONS: tuple[MouseButton, ...] = ("left", "middle", "right", "none")
_SHIFT, _ALT, _CTRL = 1, 2, 4
_MOST_PARAMETERS = 64
"""Bytes of parameters beyond which a control sequence is garbage; the longest real one has about 30."""
_REPLIES = (b"\x1bP>|", b"\x1b_G")
_PASTE_START, _PASTE_END = b"\x1b[200~", b"\x1b[201~"


class Parser:
    """Turn bytes into events, whatever pieces they come in; what means nothing is swallowed.

    Attributes
    ----------
    mouse_unit : tuple of 2 ints
        What the terminal's mouse positions count in each direction, in units per cell: (1, 1) for
        cells, the size of the cell where it reports pixels.
    """

    def __init__(self) -> None:
        self.mouse_unit = (1, 1)
        self._rest = b""
        self._spared = False
        self._skipped_to: re.Pattern[bytes] | None = None
        self._pasting = False
        self._down: dict[int | str, str] = {}

    @property
    def pending(self) -> bool:
        """Whether the bytes so far end within a sequence: more may come, or it was the Escape key."""
        return bool(self._rest or self._skipped_to)

    def feed(self, received: bytes) -> list[Reported]:
        """Return the events that are complete with these bytes."""
        events: list[Reported] = []
        text, position = self._rest + self._past_skipped(received), 0
        while position < len(text):
            parse = self._sequence if text[position] == _ESCAPE else _character
            end, event = parse(text, position)
            if end == position:
                break
            sequence, position = text[position:end], end
            if sequence in (_PASTE_START, _PASTE_END):
                self._pasting = sequence == _PASTE_START
            elif event is not None and (not self._pasting or isinstance(event, Answered)):
                events.append(event)
        self._spared &= position == 0
        self._rest = text[position:]
        if len(self._rest) > MOST_HELD:
            self._skipped_to = _CSI_END if self._rest.startswith(b"\x1b[") else _STRING_END
            self._rest = b""
        return events

    def _past_skipped(self, received: bytes) -> bytes:
        """Return what comes after a sequence that was too long to be held; nothing while it goes on."""
        if self._skipped_to is None:
            return received
        if end := self._skipped_to.search(received):
            self._skipped_to = None
            return received[end.end() :]
        return b""

    def flush(self) -> list[Reported]:
        """Return the events of the bytes held back, since no more came: a lone escape was the key.

        A started CSI stays held back, or a reply torn in two would be taken for keys; so does a string that
        begins as replies do, but only once, or one that never ends would swallow all that is typed.
        """
        rest, self._skipped_to = self._rest, None
        if not self._spared and rest.startswith(_REPLIES):
            self._spared = True
            return []
        self._spared = False
        if rest == b"\x1b":
            self._rest = b""
            return [Key("escape")]
        if len(rest) == 2:
            self._rest = b""
            return [Key(f"alt+{chr(rest[1])}")] if rest[0] == _ESCAPE else []
        if rest[:1] != b"\x1b" or rest[1:2] != b"[":
            self._rest = b""
        return []

    def _sequence(self, text: bytes, start: int) -> tuple[int, Parsed]:
        """Return where the sequence at ``start`` ends, ``start`` itself if it does not yet, and its event."""
        if _INCOMPLETE.match(text, start):
            return start, None
        if match := _CSI.match(text, start):
            return match.end(), self._control(match[1], match[2], match[3].decode())
        if match := _LINUX_F_KEY.match(text, start):
            return match.end(), Key(f"f{match[1][0] - 64}")
        if match := _SS3.match(text, start):
            letter = match[1].decode()
            name = _LETTERS.get(letter) or _KEYPAD_LETTERS.get(letter)
            name = name or (chr(ord(letter) - 64) if "p" <= letter <= "y" else None)
            return match.end(), Key(name) if name else None
        if match := _STRING.match(text, start):
            return match.end(), None
        if text[start + 1] in (_ESCAPE, ord("["), ord("O")):
            return start + 1, Key("escape")
        end, event = _character(text, start + 1)
        if end == start + 1:
            return start, None
        return end, Key(f"alt+{event.name}") if isinstance(event, Key) else None

    def _control(self, private: bytes, parameters: bytes, final: str) -> Parsed:
        """Return the event of a control sequence."""
        if len(parameters) > _MOST_PARAMETERS:
            return None
        fields = [
            [min(int(part or 0), MOST_NUMBER) for part in field.split(b":")] for field in parameters.split(b";")
        ]
        numbers = [field[0] for field in fields]
        if private == b"<" and final in "Mm" and len(numbers) == 3:
            return self._mouse(*numbers, released=final == "m")
        if private:
            return None
        modifiers = max(0, numbers[1] - 1) if len(numbers) > 1 else 0
        action = _ACTIONS.get(fields[1][1] if len(fields) > 1 and len(fields[1]) > 1 else 1, "press")
        if final == "u":
            shifted = numbers[2] if len(numbers) > 2 else fields[0][1] if len(fields[0]) > 1 else 0
            return self._as_pressed(numbers[0], _key(numbers[0], modifiers, action, shifted))
        if final == "~" and numbers[0] == 27 and len(numbers) == 3:
            return _key(numbers[2], modifiers)
        if final == "~":
            return self._as_pressed(-numbers[0], _named(_TILDES.get(numbers[0]), modifiers, action))
        if final == "t" and len(numbers) == 3 and numbers[0] in (4, 6):
            return PixelReport(numbers[0], width=numbers[2], height=numbers[1])
        if final == "t" and len(numbers) == 5 and numbers[0] == 48:
            return SizeReport(columns=numbers[2], rows=numbers[1], width=numbers[4], height=numbers[3])
        if final == "n":
            return Answered() if numbers == [0] else None
        if final in "IO" and not parameters:
            return Focus(final == "I")
        if final == "Z":
            return Key("shift+tab")
        # A first number other than 1 is a report, such as the cursor's position, and no key.
        name = _LETTERS.get(final) if numbers[0] in (0, 1) else None
        return self._as_pressed(final, _named(name, modifiers, action))

    def _as_pressed(self, identity: int | str, key: Key | None) -> Key | None:
        """Give repeats and releases the name of the press: modifiers are often let go first."""
        if key is None:
            return None
        if key.action == "press":
            if len(self._down) >= MOST_KEYS_DOWN:
                self._down.clear()
            self._down[identity] = key.name
            return key
        name = (
            self._down.pop(identity, key.name) if key.action == "release" else self._down.get(identity, key.name)
        )
        return Key(name, key.action)

    def _mouse(self, code: int, x: int, y: int, *, released: bool) -> Mouse | None:
        place = min((x - 1) / self.mouse_unit[0], MOST_COLUMNS), min((y - 1) / self.mouse_unit[1], MOST_ROWS)
        shift = bool(code & 4)
        if code & 192:
            wheel = {64: 1, 65: -1}.get(code & 195)
            return Mouse("wheel", "none", *place, wheel, shift) if wheel else None
        button = _BUTTONS[code & 3]
        motion: MouseAction = "move" if button == "none" else "drag"
        action: MouseAction = motion if code & 32 else "release" if released else "press"
        return Mouse(action, button, *place, shift=shift)


def _character(text: bytes, start: int) -> tuple[int, Parsed]:
    """Return where the character at ``start`` ends, ``start`` itself if it does not yet, and its key."""
    lead = text[start]
    length = 1 if lead < 0xC0 else 2 if lead < 0xE0 else 3 if lead < 0xF0 else 4
    encoded = text[start : start + length]
    try:
        return start + length, _plain(ord(encoded.decode()))
    except UnicodeDecodeError as error:
        torn = error.reason == "unexpected end of data"
        return (start, None) if torn else (start + 1, None)


def _plain(code: int) -> Key:
    if code in _CODES:
        return Key(_CODES[code])
    if code < 32:
        return Key("ctrl+space" if code == 0 else f"ctrl+{chr(code + 64).lower()}")
    return Key(chr(code))


def _key(code: int, modifiers: int, action: KeyAction = "press", typed: int = 0) -> Key | None:
    """Return the key of a code point or a number of the kitty keyboard; ``typed`` is what it wrote, if known."""
    name = _CODES.get(code)
    if name is None:
        if code < 32 or code in _PRIVATE_USE or code > 0x10FFFF or 0xD800 <= code < 0xE000:
            return None
        name = chr(code)
        if 32 < typed <= 0x10FFFF:
            name, modifiers = chr(typed), modifiers & ~_SHIFT
        elif modifiers & _SHIFT and name.isalpha():
            name, modifiers = name.upper(), modifiers & ~_SHIFT
    return _named(name, modifiers, action)


def _named(name: str | None, modifiers: int, action: KeyAction = "press") -> Key | None:
    if name is None:
        return None
    held = ((_CTRL, "ctrl+"), (_ALT, "alt+"), (_SHIFT, "shift+"))
    return Key("".join(word for bit, word in held if modifiers & bit) + name, action)
