"""Texts that would do something if a report took them for markup: HTML, SVG, Markdown, TeX, Typst and JavaScript."""

from __future__ import annotations

from typing import Final

HOST: Final = "payload.invalid"  # no such host exists
PAYLOADS: Final = (
    # HTML, SVG and JavaScript
    '<script>document.title="ran"</script>',
    f'<img src="http://{HOST}/a.png" onerror="document.title=1">',
    f'<iframe src="https://{HOST}/"></iframe><base href="//{HOST}">',
    '"><embed src="/etc/passwd"><!--',
    f'</title></style><svg onload="document.title=1"><image href="http://{HOST}/b.svg"/></svg>',
    "<a href='javascript:document.title=1'>here</a>",
    "javascript:document.title=1",
    f'<meta http-equiv="refresh" content="0;url=http://{HOST}/c"><link rel=stylesheet href=//{HOST}/d.css>',
    f"<style>@import url(http://{HOST}/e.css)</style>",
    "&lt;b&gt; &amp; &#x3c;i&#62;",
    # Markdown
    '`<embed src="/etc/passwd">`{=html}',
    f"![](http://{HOST}/f.png) ![x](/etc/passwd){{width=10}}",
    f"[here](javascript:document.title=1) [there](http://{HOST}/g) <http://{HOST}/h>",
    "[](#fig:nowhere) [@nobody] [^1] ^[note] [x]{.holds} {#tbl:motions}",
    "**bold** *slanted* ~~gone~~ x^2^ H~2~O `code` -- --- ... \"q\" 'r'",
    "# heading", "- point", "1. first", "(a) first", "> quote", "| cell | cell |", "::: {.summary}", "---", "Table: x",
    "\n\n# heading\n\n```{=html}\n<b>\n```\n\n    code\n",
    "{{ results }} {% include 'x' %} {# #} <!-- gone -->",
    "x\\", "`", "``` `", "$", "$$",
    # TeX
    r"$x^2$ \(x\) \[x\] $\frac{1$ $\notacommand{x}$",
    r"\input{/etc/passwd} \include{x} \newcommand{\x}{y} \begin{verbatim}",
    # Typst
    '#include "/etc/passwd" #read("/etc/passwd") #import "@preview/example:0.1.0": *',
    f'#link("http://{HOST}/i")[x] = heading <label> @label https://{HOST}/j // gone /* gone */',
    '"] #panic("x") $ #x $ _slanted_ *bold* + point / term: x ~ -? #',
    # Signs that nobody sees, that turn the text round, or that are no text
    "a\x00b\x07c\x1b[31md\x7fe\x85f\u2028g",
    "\u202egnp.exe\u202c \u2066x\u2069 \u200b\ufeff\u00ad",
    "\ud800 \ufffe \ue000 \U000e0041",
    "\u0410xis \u8ef8 7 \U0001f642 e\u0301 _begins",
    "_hidden", "a" * 300,
)  # fmt: skip
