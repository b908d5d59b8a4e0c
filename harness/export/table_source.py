"""C source of a motion from a table: the splines' polynomials, and their evaluation in constant time."""

import re

from gough_stewart.harness.export.texts import number, numbers
from gough_stewart.harness.motion.motion import ROUNDING, Piecewise

_TEXT = """/* Polynomials between the rows of a table: six coordinates per piece, highest power first. */
#define TABLE_END @END@
#define TABLE_ROUNDING @ROUNDING@
enum { N_PIECES = @N@ };
static const double BEGINS[N_PIECES] = {@BEGINS@};
static const double PIECES[N_PIECES][6][6] = {
@PIECES@
};

/* x, y, z, roll, pitch, yaw and their first and second derivatives. */
static void table_at(double time, double pose[6], double rate[6], double acceleration[6])
{
    int piece = 0, step, k, j;
    double s;
    const double moves = time <= TABLE_END + TABLE_ROUNDING ? 1 : 0;
    if (time > TABLE_END) time = TABLE_END;
    if (time < BEGINS[0]) time = BEGINS[0];
    for (step = @STEP@; step > 0; step /= 2)
        if (piece + step < N_PIECES && BEGINS[piece + step] <= time) piece += step;
    s = time - BEGINS[piece];
    for (k = 0; k < 6; ++k) {
        double value = 0, slope = 0, half = 0;
        for (j = 0; j < 6; ++j) {
            half = half * s + slope;
            slope = slope * s + value;
            value = value * s + PIECES[piece][k][j];
        }
        pose[k] = value;
        rate[k] = moves * slope;
        acceleration[k] = moves * 2 * half;
    }
}
"""


def numbers_in(text: str) -> int:
    """How many numbers the constant arrays of a text have."""
    arrays = re.findall(r"^static const double \w+(?:\[\w+\])+ = \{(.*?)\};", text, re.M | re.S)
    return sum(len(re.findall(r"[^\s{},]+", array)) for array in arrays)


def table_of(reference: Piecewise) -> str:
    """The table and its evaluation."""
    begins, pieces = reference.pieces
    n = len(begins)
    rows = ["    {" + ", ".join("{" + numbers(each) + "}" for each in piece) + "}," for piece in pieces]
    step = 1
    while 2 * step < n:
        step *= 2
    words = {
        "END": number(reference.end),
        "ROUNDING": number(ROUNDING),
        "N": str(n),
        "BEGINS": numbers(begins),
        "PIECES": "\n".join(rows),
        "STEP": str(step),
    }
    text = _TEXT
    for name, value in words.items():
        text = text.replace(f"@{name}@", value)
    return text
