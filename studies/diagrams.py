"""The paper's block diagrams, drawn from the machine: Figs. 1, 6 and 13, 10 and 11."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from matplotlib.figure import Figure as Drawing

from models.quantity import show
from reports.blocks import Sheet
from reports.markup import Markdown
from reports.report import Figure

Results = Mapping[str, Any]

PLANT: Final = "#fdf3e7"  # the colour of what is not the controller's
SETUP = (
    "The axis: a table with a flexible load on rolling guides, whose stand rests on levelling bolts. Fig. 1 of the "
    "paper."
)
LOOP = Markdown(
    "The two-degree-of-freedom controller around the nonsmooth machine. Fig. 13 of the paper; without the dashed "
    "block, its Fig. 6. $z^{-d}$ makes the feedback's reference wait for the dead time."
)
ELEMENTS = Markdown(
    "The friction: an element of spring, damper and slider with its force over the displacement (Fig. 10 of the "
    "paper), and $N$ of them in parallel (its Fig. 11)."
)


def setup_figure() -> Figure:
    """Fig. 1."""
    return Figure("setup", SETUP, ("machine.plant", "machine.drive", "machine.sample_time_s"), _setup)


def loop_figure(elements: str) -> Figure:
    """Figs. 6 and 13; elements: the dotted key in results.json of the compensator's elements, or of their number."""
    return Figure("loop", LOOP, (elements,), lambda whole: _loop(whole, elements))


def elements_figure() -> Figure:
    """Figs. 10 and 11."""
    return Figure("friction", ELEMENTS, ("machine.friction",), _elements)


def _setup(whole: Results) -> Drawing:
    machine = whole["machine"]
    modes = [one["frequency_Hz"] for one in machine["plant"]["modes"] if one["frequency_Hz"] > 0]
    sheet = Sheet(52)
    for x in (22, 48, 74):  # levelling bolts on the floor
        sheet.box((x, 7), "", (4, 6), face="#d9d9d9")
    sheet.line((8, 4), (96, 4), width=1.6)
    sheet.box((48, 15), "machine stand", (76, 10))
    for x in (32, 44, 56, 68):
        sheet.sum((x, 22.4))
    sheet.text((74, 22.6), "rolling guides", ha="left")
    sheet.box((50, 30), "table", (46, 10))
    sheet.box((46, 42), "flexible load", (24, 7))
    sheet.line((40, 35), (38, 38.5))
    sheet.line((52, 35), (54, 38.5))
    sheet.arrow((73, 30), (92, 30), text="$x_T$", at=(88, 33))
    sheet.text((15, 30), "linear motor", ha="center")
    sheet.arrow((7, 26), (27, 26), text="$u_M$", at=(12, 23.4))
    sheet.box((124, 40), f"controller, $T_s$ = {show(machine['sample_time_s'], 's')}", (52, 9))
    sheet.box((124, 24), f"drive, ±{show(machine['drive']['rated_thrust_N'], 'N')}", (52, 9))
    sheet.arrow((124, 35.5), (124, 28.5), text="$u_M$", at=(129, 32))
    said = ", ".join(f"{frequency:.4g} Hz" for frequency in modes) or "none"
    sheet.text((124, 13), f"vibration modes: {said}")
    sheet.text((124, 8), f"dead time $L$ = {show(machine['plant']['dead_time_s'], 's')}")
    return sheet.figure


def _loop(whole: Results, elements: str) -> Drawing:
    found: Any = whole
    for key in elements.split("."):
        found = found[key]
    count = found if isinstance(found, int) else len(found)
    sheet = Sheet(66)
    main, rfm, upper, lower = 24.0, 42.0, 58.0, 7.0
    sheet.arrow((3, main), (15, main), text="$r$", at=(5, main + 2.6))
    sheet.dot((9, main))
    sheet.box((24, main), "$N_{ff}(z)$")
    sheet.arrow((33, main), (46, main), text="$x_T^*$", at=(37, main + 3))
    sheet.box((53, main), "$z^{-d}$", (14, 9))
    sheet.arrow((60, main), (67.8, main))
    sheet.sum((70, main), (("−", (-2.6, -3.6)),))
    sheet.arrow((72.2, main), (77, main))
    sheet.box((85, main), "$C(z)$", (16, 9))
    sheet.arrow((93, main), (99.8, main))
    sheet.sum((102, main))
    sheet.arrow((104.2, main), (110, main), text="$u_M$", at=(106.8, main + 2.8))
    sheet.box((115.5, main), "$e^{-Ls}$", (11, 9), face=PLANT)
    sheet.arrow((121, main), (124.8, main))
    sheet.sum((127, main), (("−", (-2.8, 3.6)),))
    sheet.arrow((129.2, main), (132, main))
    sheet.box((138, main), "$P'_l$", (12, 9), face=PLANT)
    sheet.arrow((144, main), (158, main), text="$x_T$", at=(156.5, main + 2.8))
    sheet.arrow((9, main), (9, upper), (15, upper))
    sheet.box((24, upper), "$D_{ff}(z)$")
    sheet.arrow((33, upper), (102, upper), (102, rfm + 2.2), text="$u_{ff}$", at=(66, upper + 2.8))
    sheet.dot((41, main))
    sheet.arrow((41, main), (41, rfm), (62, rfm))
    sheet.box((73, rfm), f"RFM, $N$ = {count}", (22, 9), dashed=True)
    sheet.arrow((84, rfm), (99.8, rfm), text="$u_{rf}$", at=(90, rfm + 2.8))
    sheet.sum((102, rfm))
    sheet.arrow((102, rfm - 2.2), (102, main + 2.2))
    sheet.dot((148, main))
    sheet.arrow((148, main), (148, rfm), (145, rfm))
    sheet.box((138, rfm), "rolling\nfriction", (14, 9), face=PLANT)
    sheet.arrow((131, rfm), (127, rfm), (127, main + 2.2), text="$f$", at=(125, rfm - 6))
    sheet.dot((152, main))
    sheet.arrow((152, main), (152, lower), (119, lower))
    sheet.box((109, lower), "scale", (20, 8))
    sheet.arrow((99, lower), (70, lower), (70, main - 2.2))
    return sheet.figure


def _elements(whole: Results) -> Drawing:
    friction = whole["machine"]["friction"]
    count = len(friction["limit_m"])
    sheet = Sheet(50)
    sheet.line((6, 22), (6, 38), width=1.6)
    for height in (26, 34):
        sheet.line((6, height), (8, height))
    sheet.spring((8, 34), 16)
    sheet.damper((8, 26), 16)
    sheet.line((24, 26), (24, 34))
    sheet.text((16, 38.4), "$K_i$")
    sheet.text((16, 21.4), "$D_i$")
    sheet.line((24, 30), (28, 30))
    sheet.box((33, 30), "slider", (10, 6))
    sheet.text((33, 24), "$\\pm F_{mi}$")
    sheet.arrow((38, 30), (46, 30), text="$x$", at=(44, 32.8))
    sheet.text((25, 9), "an element, eqs. (3) to (7)")
    sheet.arrow((52, 28), (80, 28), text="$x$", at=(79, 25.2))
    sheet.arrow((66, 14), (66, 44), text="$f_i$", at=(69, 43))
    sheet.line((56, 19), (62, 37), (76, 37), (70, 19), (56, 19), width=1.4)
    sheet.line((62, 37), (66, 37), width=0.6, dashed=True)
    sheet.text((60, 39.6), "$F_{mi}$")
    sheet.text((74, 16), "$2 X_{mi}$")
    sheet.arrow((88, 30), (96, 30), text="$x$", at=(90, 32.8))
    sheet.line((96, 12), (96, 45))
    rows = ((43.0, "1"), (33.0, "2"), (14.0, str(count) if count > 2 else "N"))
    for y, number in rows:
        sheet.arrow((96, y), (101, y))
        sheet.box((115, y), f"$K_{{{number}}}$, $D_{{{number}}}$, $F_{{m{number}}}$", (28, 7))
        sheet.line((129, y), (138, y))
    sheet.text((115, 24), "⋮")
    sheet.line((138, 14), (138, 43))
    sheet.arrow((138, 30), (142.8, 30))
    sheet.sum((145, 30))
    sheet.arrow((147.2, 30), (158, 30), text="$f_{rolling}$", at=(153, 33.2))
    sheet.text((122, 6), "$N$ elements in parallel, eq. (8)")
    return sheet.figure
