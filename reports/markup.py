"""What is text and what is markup: in a report every `str` is text and is shown as it was typed.

Names, sources, records and options come from files that strangers may have written. Only a `Markdown` is markup, and
only our own templates, captions and filters make one; whatever is done to it beside adding to it gives a `str`, hence
text. So markup that somebody forgot to mark is shown with all its signs, and text can not become markup.
"""

from __future__ import annotations

import re
import unicodedata
from typing import Any, Final

NUMBER: Final = re.compile(r"[+-]?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?")
MARK: Final = re.compile(r"([!-/:-@\[-`{-~])")  # ASCII punctuation
APOSTROPHE: Final = re.compile(r"(?<=[^\W\d_])'")
BLANKS: Final = re.compile(r"[\t\n\v\f\r\x1c-\x1f\x85\u2028\u2029 ]+")
RAISED: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")  # of a power of ten
JOINERS: Final = "\u2060\u200c\u200d"  # no line ends here; letters of some scripts and emoji need the other two


class Markdown(str):
    """Markup of our own. Adding a `str` to it adds that as text."""

    __slots__ = ()

    def __add__(self, other: str) -> Markdown:
        """This, followed by `other`, which is escaped unless it is markup as well."""
        return Markdown(str.__add__(self, escape(other)))

    def __radd__(self, other: str) -> Markdown:
        """`other`, escaped unless it is markup as well, followed by this."""
        return Markdown(str.__add__(escape(other), self))


def escape(value: Any) -> Markdown:
    """The Markdown that shows `value` as it was typed; a `Markdown` stays what it is.

    Blanks in a row, line ends among them, are one space. A sign that nobody sees or that changes the order of its
    neighbours is shown by its code, '[U+202E]'. An apostrophe behind a letter is set as one. A plain number stays as
    it is, so that it can stand in a formula.
    """
    if isinstance(value, Markdown):
        return value
    text = str(value)
    if NUMBER.fullmatch(text):
        return Markdown(text)
    return Markdown(MARK.sub(r"\\\1", APOSTROPHE.sub("\u2019", visible(text))))


def visible(text: str) -> str:
    """The text on one line, with the code of every sign that has no look of its own."""
    return "".join(_seen(letter) for letter in BLANKS.sub(" ", text))


def formula(tex: str) -> Markdown:
    """A formula of the catalogue of effects, to stand between the dollars of a template.

    Raises `ValueError` for one that could end the mathematics.
    """
    shown = visible(tex).strip()
    if "$" in shown or shown.endswith("\\"):
        raise ValueError(f"not a formula that can be shown: {tex[:80]!r}")
    return Markdown(shown)


def unlinked(markdown: str, words: str) -> Markdown:
    """The text or markup with `words` where it refers to a table."""
    return Markdown(re.sub(r"\[\]\(#tbl:[\w-]+\)", words, escape(markdown)))


def code(text: str) -> Markdown:
    """The text in letters of one width."""
    shown = visible(text).strip()
    blank = " " if shown.startswith("`") or shown.endswith("`") else ""
    return Markdown(f"{_fence(shown, 1)}{blank}{shown}{blank}{_fence(shown, 1)}")


def block(text: str) -> Markdown:
    """The lines of a text in letters of one width, to stand between empty lines of a template."""
    shown = "\n".join("".join(_seen(letter) for letter in line) for line in text.split("\n"))
    return Markdown(f"{_fence(shown, 3)}\n{shown}\n{_fence(shown, 3)}")


def _fence(text: str, least: int) -> str:
    """More backticks than any run of them in the text."""
    return "`" * max(least, *(len(run) + 1 for run in re.findall("`+", text)), 0)


def for_figure(value: Any) -> Any:
    """`value`, as a figure may draw it: dollars do not begin mathematics, and no name is left out of a legend.

    Goes through plain data, keys included, so that what names something still finds it.
    """
    if isinstance(value, str):
        # A label that begins with an underscore is not shown in a legend; the mark before it takes no room.
        text = visible(value).replace("$", r"\$")
        return f"\u200b{text}" if text.startswith("_") else text
    if isinstance(value, dict):
        return {for_figure(key): for_figure(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [item if type(item) is float else for_figure(item) for item in value]
    return value


def _seen(letter: str) -> str:
    kind = unicodedata.category(letter)
    if kind in {"Cc", "Cf", "Cn", "Co", "Cs"} and letter not in JOINERS:
        return f"[U+{ord(letter):04X}]"
    return letter
