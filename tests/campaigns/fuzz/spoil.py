"""Files spoilt at random: their text, and the elements and attributes of XML."""

from __future__ import annotations

import copy
import random
import re
from xml.etree import ElementTree

NUMBERS = (
    *("nan", "inf", "-inf", "0", "-0.0", "-1", "1", "1e308", "-1e308", "1e-308", "5e-324", "1e999", "1e20"),
    *(
        "1e-20",
        "1e9",
        "1_0",
        "0x10",
        "１",
        "9" * 400,
        "9" * 5000,
        "1e200 1e200 1e200",
        "1e-200 0 0",
        "nan 0 0",
    ),
)
WORDS = (
    *("", " ", "1 2", "0 0 0", "1 1", "1,2", "0 0 0 0", "0 0 0 1e-300", "abc", "true", "free", "ball"),
    *("fixed", "floating", "planar", "prismatic", "continuous", "revolute", "hinge", "slide", "universe"),
    *("world", "../x", "\u0442", "a" * 300, "%s%n", "<", "3d", "6D", "auto", "\u2028"),
)
SNIPPETS = (
    *("&a [*a]", "*a", "!!python/object/apply:os.getcwd []", "!!binary x", "!!int ''", "!!bool x"),
    *("!!timestamp hello", "!!float ''", "<<: {a: 1}", "? [1]", "2001-99-99", "1:30", "~", ".nan", "-.inf"),
    *("1:1" * 2000, "[" * 60, "{a: " * 60, "\t", "---", "{", "\x00", "\ud800", "%YAML 9.9\n---\n", "'", '"'),
    *("#", "- ", ": ", "home: {}", "<!DOCTYPE r [<!ENTITY x 'y'>]>", "<![CDATA[", "]]>", "<?x?>", "<!--"),
    *("&x;", "<a>", "</link>", "</body>", "<joint/>", "<link/>", "\ufeff"),
)
CHANGES = (1, 1, 1, 2, 3)
"""Most files are spoilt in one place, so that what lies behind is reached."""

NUMBER = re.compile(r"-?\d+\.?\d*(?:[eE]-?\d+)?")


def spoiled(text: str, of_xml: bool, rng: random.Random) -> str:
    """The text with one to three changes."""
    try:
        return spoiled_xml(text, rng) if of_xml and rng.random() < 0.75 else spoiled_text(text, rng)
    except (ElementTree.ParseError, ValueError):
        return spoiled_text(text, rng)


def spoiled_xml(text: str, rng: random.Random) -> str:
    """The document with its elements and attributes changed."""
    root = ElementTree.fromstring(text)
    for _ in range(rng.choice(CHANGES)):
        _spoil_element(root, rng)
    return ElementTree.tostring(root, encoding="unicode")


def spoiled_text(text: str, rng: random.Random) -> str:
    """The text cut, ended, doubled, overwritten, its numbers and lines replaced."""
    for _ in range(rng.choice(CHANGES)):
        at, length = rng.randint(0, len(text)), rng.randint(0, 60)
        part, new = text[at : at + length], rng.choice(NUMBERS + WORDS + SNIPPETS)
        action = rng.choice(("cut", "end", "double", "insert", "overwrite", "number", "number", "lines"))
        if action == "cut":
            text = text[:at] + text[at + length :]
        elif action == "end":
            text = text[:at]
        elif action == "double":
            text = text[:at] + part + text[at:]
        elif action in ("insert", "overwrite"):
            text = text[:at] + new + text[at + (length if action == "overwrite" else 0) :]
        elif action == "lines":
            lines = text.splitlines(keepends=True) or [""]
            first, second = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines[first], lines[second] = lines[second], rng.choice(lines)
            text = "".join(lines)
        elif found := NUMBER.search(text, at):
            text = text[: found.start()] + rng.choice(NUMBERS + WORDS) + text[found.end() :]
    return text


def _spoil_element(root: ElementTree.Element, rng: random.Random) -> None:
    """One change of the document's elements or attributes."""
    parents = {child: parent for parent in root.iter() for child in parent}
    elements = list(parents) or [root]
    one, other = rng.choice(elements), rng.choice(elements)
    key = rng.choice(sorted(one.attrib) or ["name"])
    action = rng.choice(("set", "set", "set", "number", "swap", "drop", "lose", "twice", "move", "rename"))
    if action == "set":
        one.set(key, rng.choice(NUMBERS + WORDS))
    elif action == "number":
        words = one.get(key, "").split() or ["0"]
        words[rng.randrange(len(words))] = repr(rng.choice((-1.0, 1.0)) * 10.0 ** rng.uniform(-320.0, 308.0))
        one.set(key, " ".join(words))
    elif action == "swap" and key in one.attrib and key in other.attrib:
        one.attrib[key], other.attrib[key] = other.attrib[key], one.attrib[key]
    elif action == "drop":
        one.attrib.pop(key, None)
    elif action == "rename":
        one.tag = other.tag
    elif one in parents and action == "lose":
        parents[one].remove(one)
    elif one in parents and action == "twice":
        parents[one].append(copy.deepcopy(one))
    elif one in parents and action == "move" and other not in one.iter():
        parents[one].remove(one)
        other.append(one)
