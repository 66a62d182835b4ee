"""Faults that are planted in the exported C, each of which its self-test has to catch."""

from __future__ import annotations

from typing import Final

# Right text of axis_law.c, and a fault in its place; those of parts that a law lacks are left out.
FAULTS: Final = {
    "the reference does not wait": ("(law->newest + AXIS_DELAY)", "(law->newest + 0 * AXIS_DELAY)"),
    "the reference waits a sample more": ("(law->newest + AXIS_DELAY)", "(law->newest + AXIS_DELAY + 1)"),
    "x_T* one sample late": ("y += POSITION[j]", "y += POSITION[j ? j - 1 : 0]"),
    "one coefficient too few": ("j < AXIS_STEPS", "j < AXIS_STEPS - 1"),
    "the sign of u_ff": ("u += THRUST", "u -= THRUST"),
    "the sign of the error": ("((law->target[late] - position) +", "((position - law->target[late]) +"),
    "another order of the sum": ("((u + compensation) + planned)", "(u + (compensation + planned)) + 1.0e-13"),
    "u_ff is left out": ("wanted = law->feedback + ((u +", "wanted = law->feedback + ((0 * u +"),
    "the derivative forgets the last error": ("law->last_error = error;", ""),
    "the derivative is not filtered": ("keep * law->slope", "0 * law->slope"),
    "the integral is lost": ("* error + law->integral +", "* error +"),
    "the limit holds on one side only": ("return least > -limit ? least : -limit;", "return least;"),
    "elements do not slip": ("law->element[i] = within(law->element[i], LIMIT[i]);", ""),
    "the elements' state is lost": ("add(&law->element[i], &law->element_low[i], step);", "law->element[i] = step;"),
    "the elements do not follow the base": ("(axis_real)(base - law->last_base) + (", "("),
    "a NaN gets through": ("if (!(position >= -FAR && position <= FAR))", "if (position < -FAR || position > FAR)"),
    "a missing reading becomes 0": ("position = law->last_reading;", "position = 0.0;"),
    "a reset keeps the elements": ("law->element[i] = law->element_low[i] = (axis_real)0.0;", ";"),
    "a reset forgets the thrust": ("law->integral = held", "law->integral = 0 * held"),
    "a reset forgets a law's thrust": ("LAW_HOLD[i] * held", "0 * LAW_HOLD[i] * held"),
    "a law's state is a sample old": ("law->state[i] = next[i];", "law->state[i] = i ? next[i] : law->state[i];"),
    "the wipe comes back a sample late": ("sample <= WIPE_HALF)", "sample <= WIPE_HALF + 1)"),
    "u_rf sets in with a bump": ("law->zero = force;", ";"),
    "the status hides the limit": ("status |= AXIS_LIMITED;", ";"),
    "no anti-windup": ("* excess);", "* 0 * excess);"),
    "a rest is averaged from a sample later on": ("sample >= WIPE_HALF - WINDOW", "sample >= WIPE_HALF - WINDOW + 1"),
    "learning forgets the wipe's rests": ("law->rests[i][back] = force_of(law, i);", "law->rests[i][back] = 0.0;"),
    "every length goes the nominal way": ("axis_real way = STRETCH[i] * step;", "axis_real way = step;"),
    "the worst length is taken": ("missed < fewest", "missed > fewest"),
    "a motion down teaches as one up": ("change > (axis_real)0.0 ? 1.0 : -1.0", "1.0"),
    "other strokes teach, too": ("stroke ? 0 : -1;", "stroke ? 0 : 0;"),
    "the dead time is not learned": ("law->all_late += law->by_late;", ""),
    "u_ff keeps its scale": ("law->gain = (axis_real)(1.0 + mass);", ""),
    "x_T* keeps the nominal dead time": ("(double)POSITION[j] + late *", "(double)POSITION[j] + 0.0 * late *"),
    "a round keeps the sums of the one before": ("law->sums[i][1] = law->sums[i][2] = 0.0;", "law->sums[i][1] = 0.0;"),
    "a reset forgets what was learned": (
        "law->newest = 0;\n    law->round = -1;",
        "law->newest = 0;\n    forget(law);",
    ),
    "a reset does not end the learning": ("law->newest = 0;\n    law->round = -1;", "law->newest = 0;"),
    "what was learned sets in with a bump": ("law->chosen) - law->compensation;", "law->chosen);"),
}
