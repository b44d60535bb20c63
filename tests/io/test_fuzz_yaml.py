"""Model folders with robot.yaml spoilt by the thousand: a sane mechanism or an error of ours."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import robust_gcp as rg
from robust_gcp.io.loader import models_folder

pytestmark = pytest.mark.filterwarnings("ignore::robust_gcp.ModelWarning")
"""Limits of joints are not what these tests are about."""

FUZZ = settings.get_profile("fuzz")
Accepted = Callable[[Callable[[], object]], object]
Sane = Callable[[rg.Mechanism], None]

NAMES = ("crank_rocker", "five_bar", "flyball", "bricard", "stewart", "andrews")
TEXTS = {name: (models_folder() / name / "robot.yaml").read_text(encoding="utf-8") for name in NAMES}
SNIPPETS = (
    *("&a [*a]", "*a", "!!python/object/apply:os.getcwd []", "!!binary x", "<<: {a: 1}", "? [1]"),
    *("9" * 5000, "1" + "0" * 400, "2001-99-99", "0x", "1:30", "~", ".nan", "-.inf", "\t", "---", "{"),
    *("[" * 60, "\u2028", "\x00", "%YAML 9.9\n---\n", "'", '"', "#", "- ", ": ", "schema: 1", "home: {}"),
)
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=6)
    | st.sampled_from((10**400, "q1", "q2", "shaft", "3d", "6D", "revolute", "auto", "FIXED", "UJOINT_XY"))
    | st.dates()
    | st.binary(max_size=3)
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(SCALARS, inner, max_size=3),
    max_leaves=6,
)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A copy of each shipped model, its YAML overwritten by each example."""
    made = {}
    for name in NAMES:
        made[name] = tmp_path_factory.mktemp(name)
        urdf = (models_folder() / name / "robot.urdf").read_text(encoding="utf-8")
        (made[name] / "robot.urdf").write_text(urdf, encoding="utf-8")
    return made


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Each container and key below a value."""
    keys = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in list(keys):
        yield value, key
        yield from places(value[key])


def spoil(draw: Any, settings_: dict[str, Any]) -> dict[str, Any]:
    """One to three changes of the tree of values: replaced, removed, doubled, swapped, keys renamed."""
    settings_ = copy.deepcopy(settings_)
    for _ in range(draw(st.integers(1, 3))):
        found = list(places(settings_))
        if not found:
            break
        (box, key), (other, other_key) = (draw(st.sampled_from(found)) for _ in range(2))
        action = draw(st.sampled_from(("set", "number", "lose", "swap", "double", "add", "rename")))
        if not (isinstance(box, list | dict) and _there(box, key) and _there(other, other_key)):
            continue
        if action == "set":
            box[key] = draw(VALUES)
        elif action == "number":
            box[key] = draw(st.floats() | st.integers() | st.sampled_from((10**400, -(10**400), 5e-324)))
        elif action == "lose":
            del box[key]
        elif action == "swap":
            box[key], other[other_key] = copy.deepcopy(other[other_key]), copy.deepcopy(box[key])
        elif action == "double" and isinstance(box, list):
            box.append(copy.deepcopy(box[key]))
        elif action == "add" and isinstance(box, dict):
            more = ("joint_name", "joint_type", "axes", "springs", "dampers", "torques")
            box[draw(st.sampled_from(more))] = draw(VALUES)
        elif action == "rename" and isinstance(box, dict):
            box[draw(st.text(max_size=4) | st.sampled_from(("q1", "home", "type")))] = box.pop(key)
    return settings_


def _there(box: Any, key: Any) -> bool:
    return key in box if isinstance(box, dict) else key < len(box)


def load(folder: Path, text: str, accepted: Accepted, require_sane: Sane) -> None:
    (folder / "robot.yaml").write_bytes(text.encode("utf-8", "surrogatepass"))
    made = accepted(lambda: rg.load(folder))
    if isinstance(made, rg.Mechanism):
        require_sane(made)


@FUZZ
@given(name=st.sampled_from(NAMES), data=st.data())
def test_values(
    name: str, data: st.DataObject, folders: dict[str, Path], accepted: Accepted, require_sane: Sane
) -> None:
    spoilt = spoil(data.draw, yaml.safe_load(TEXTS[name]))
    load(folders[name], yaml.safe_dump(spoilt, allow_unicode=True), accepted, require_sane)


@FUZZ
@given(name=st.sampled_from(NAMES), data=st.data())
def test_text(
    name: str, data: st.DataObject, folders: dict[str, Path], accepted: Accepted, require_sane: Sane
) -> None:
    text = TEXTS[name]
    for _ in range(data.draw(st.integers(1, 3))):
        at, length = data.draw(st.integers(0, len(text))), data.draw(st.integers(0, 30))
        new = data.draw(st.sampled_from(SNIPPETS) | st.text(max_size=5) | st.just(text[at : at + length]))
        text = text[:at] + new + text[at + data.draw(st.sampled_from((0, length))) :]
    load(folders[name], text, accepted, require_sane)


@FUZZ
@given(value=VALUES, independent=st.none() | st.just("auto") | VALUES)
def test_anything_in_place_of_a_document(
    value: Any, independent: Any, folders: dict[str, Path], accepted: Accepted
) -> None:
    """No mechanism comes of values that mention no joint of the tree, unless it has no loop."""
    folder = folders["crank_rocker"]
    (folder / "robot.yaml").write_text(yaml.safe_dump(value), encoding="utf-8")
    made = accepted(lambda: rg.load(folder, independent))
    assert made is None or (isinstance(made, rg.Mechanism) and not made.closures)


@FUZZ
@given(name=SCALARS | st.lists(st.text(max_size=3), max_size=2) | st.text(min_size=300, max_size=400))
def test_names_that_are_none(name: Any, accepted: Accepted) -> None:
    assert accepted(lambda: rg.load(name)) is None


@pytest.mark.parametrize("name", NAMES)
def test_what_is_spoilt_is_sound(
    name: str, folders: dict[str, Path], accepted: Accepted, require_sane: Sane
) -> None:
    """Rewritten without a change, each folder loads, so that the properties are not empty."""
    (folders[name] / "robot.yaml").write_text(json.dumps(yaml.safe_load(TEXTS[name])), encoding="utf-8")
    made = rg.load(folders[name])
    assert made.independent == rg.load(name).independent
    require_sane(made)
