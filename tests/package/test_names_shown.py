"""Names from files as they are shown: in terminals of any encoding, and in figures."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.checks import plain
from robust_gcp.examples import linkages
from robust_gcp.printing import complain, say, table

ODD = ("a\x1b[31mred", "$\\frac{1}$", "b\x07\x9b", "half $", "right\u202eleft")


def test_control_characters_are_escaped_and_others_are_not() -> None:
    assert plain("δ_loc – q1\nλ\u00a0") == "δ_loc – q1\nλ\u00a0"
    assert plain("\x1b[2J\x9b\t\u202e\ud800") == "\\u001b[2J\\u009b\\u0009\\u202e\\ud800"


@pytest.mark.parametrize("name", ODD)
def test_nothing_that_a_name_holds_steers_a_terminal(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    say(name)
    complain(name)
    say(table(["joint", " q"], [[name + "\n", "1"]]))
    shown = "".join(capsys.readouterr())
    assert all(c.isprintable() or c == "\n" for c in shown)
    assert shown.count("\n") == 4


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
@pytest.mark.parametrize("command", [["models"], ["analyse", "rhombus", "--q", "0", "0", "0"]])
def test_commands_print_in_any_encoding(
    encoding: str, command: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", stream)
    assert main(command) == 0
    stream.flush()
    assert "rhombus" in stream.buffer.getvalue().decode(encoding)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ODD[:4])
@pytest.mark.parametrize("form", ["svg", "pdf"])
def test_figures_show_names_as_they_are(name: str, form: str, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    base = linkages.four_bar(1.0, 1.0, 1.0, 1.0, y=0.5)
    mech = rg.Mechanism.from_pinocchio(base.model, base.closures, ["q1"], base.home, name=name)
    figure = rg.simulate(mech, duration=0.02, step=1e-2).plot()
    file = io.BytesIO()
    figure.savefig(file, format=form)
    if form == "svg":
        from xml.etree import ElementTree

        ElementTree.fromstring(file.getvalue())
