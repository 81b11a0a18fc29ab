from __future__ import annotations

import pytest

from tsplat.encode import ENCODERS
from tsplat.errors import OptionError
from tsplat.terminal.outputs import OUTPUTS, choose_output, offers, outputs
from tsplat.terminal.probe import TRUECOLOR, Profile


def test_an_output_is_what_was_asked_for_then_the_variable_then_the_best() -> None:
    kitty = Profile(kitty_graphics=True, colors=TRUECOLOR)
    assert choose_output(None, {}, kitty) == "kitty"
    assert choose_output(None, {"TSPLAT_OUTPUT": "half"}, kitty) == "half"
    assert choose_output("half256", {"TSPLAT_OUTPUT": "half"}, kitty) == "half256"
    assert choose_output("sixel", {}, kitty) == "sixel"
    assert choose_output(None, {"TSPLAT_OUTPUT": ""}, Profile()) == "quadrant"


def test_an_unknown_output_is_refused_by_the_name_of_where_it_stands() -> None:
    with pytest.raises(OptionError, match=r"output must be one of kitty, iterm2, .*, braille, ascii, got 'gif'"):
        choose_output("gif", {}, Profile())
    with pytest.raises(OptionError, match="TSPLAT_OUTPUT must be"):
        choose_output(None, {"TSPLAT_OUTPUT": "gif"}, Profile())


@pytest.mark.parametrize("colors", [TRUECOLOR, 256, 16, 0])
@pytest.mark.parametrize("program", ["", "mlterm", "linux", "ghostty", "tmux"])
def test_every_encoder_is_judged_once_and_something_is_always_offered(program: str, colors: int) -> None:
    judged = offers(Profile(program=program, colors=colors))
    assert sorted(offer.name for offer in judged) == sorted(OUTPUTS)
    assert all(offer.why for offer in judged)
    assert {"half", "half256"} & set(outputs(Profile(program=program, colors=colors)))


def test_what_is_refused_says_why() -> None:
    why = {offer.name: offer.why for offer in offers(Profile(replies={"kitty graphics": "OK"}, program="WezTerm"))}
    assert why["kitty"] == "WezTerm answers OK, but draws it wrong in places"
    assert why["sixel"] == "DA1 names no attribute 4"
    silent = Profile(kitty_graphics=True, colors=0)
    assert next(offer for offer in offers(silent) if offer.name == "kitty").why == "NO_COLOR is set"


def test_every_encoder_is_an_output_and_the_other_way_round() -> None:
    assert OUTPUTS == ENCODERS
