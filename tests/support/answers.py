"""Makes the answers of `datasets/bench` anew, by the Taylor oracle with fifty digits (some
minutes).

`python -m support.answers [NAME ...]`, from the folder of the tests. Inputs stay; besides the
answers the file says by how much one rounding of each input together moves them, over their scales
(`rounding`): nobody can promise less.
"""

import csv
import sys
from decimal import Decimal, localcontext

from support import taylor, taylor_series
from support.taylor import OUTPUTS

from fitball.data.bundled import datasets_folder

HARD_CASES, SCENES = (
    datasets_folder() / "bench" / f"{name}.csv" for name in ("hard_cases", "scenes")
)
IMPACT = ("v_x1", "v_y1", "omega_1")
PARAMETERS = (
    "mass_ratio",
    "k_y",
    "k_theta",
    "mu",
    "eps_10",
    "eps_slope",
    "cor_10",
    "cor_slope",
    "zeta_theta",
    "inertia_split",
)

# Digits that are enough for the sensitivity, which is printed with two.
ENOUGH = taylor_series.FIFTY._replace(digits=36)


def options_of(row):
    """Options that differ from the default."""
    return dict(pair.split("=") for pair in row["options"].split("+") if pair)


def scales(impact, contact_time, gap_time, radius=0.03302):
    """What errors of OUTPUTS are relative to: the speed of the ball's surface, and the times."""
    speed = (float(impact[0]) ** 2 + float(impact[1]) ** 2) ** 0.5 + radius * abs(float(impact[2]))
    gap = float(gap_time)
    return (
        speed,
        speed,
        speed / radius,
        float(contact_time),
        gap,
        speed * gap,
        speed * gap / radius,
    )


def sensitivity(options, values, impact, answer):
    """By how much one rounding of each input together moves the outputs, the largest over its
    scale.
    """
    moved = [0.0] * len(OUTPUTS)
    sizes = scales(impact, answer.contact_time, answer.gap_time)
    with localcontext(prec=60):
        unit = Decimal(2) ** -53
        inputs = {**values, **dict(zip(IMPACT, impact, strict=True))}
        for name, number in inputs.items():
            if number == 0:
                continue
            # One side may have no answer: at a wall.
            for side in (1, -1):
                changed = {**inputs, name: Decimal(number) * (1 + side * unit)}
                other = taylor.solve(options, changed, [changed[k] for k in IMPACT], kind=ENOUGH)
                if other.status == "OK":
                    break
            for k, output in enumerate(OUTPUTS):
                moved[k] += abs(float(getattr(other, output) - getattr(answer, output))) / sizes[k]
    return max(moved)


def main():
    """Rewrite both files: all cases, or those named on the command line."""
    for path in (HARD_CASES, SCENES):
        rewrite(path)


def rewrite(path):
    """Rewrite a file of cases, in all of its rows or those named on the command line."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in [row for row in rows if row["name"] in sys.argv[1:] or len(sys.argv) == 1]:
        options = options_of(row)
        impact = [float(row[name]) for name in IMPACT]
        values = {name: float(row[name]) for name in PARAMETERS if row[name]}
        answer = taylor.solve(options, values, impact, kind=taylor_series.FIFTY)
        row |= {"status": answer.status}
        if answer.status == "OK":
            row |= {name: repr(float(getattr(answer, name))) for name in OUTPUTS}
            row |= {"regime": f"{answer.regime(1e-12):o}"}
            row |= {"rounding": f"{sensitivity(options, values, impact, answer):.1e}"}
        print(row["name"], row["status"], row["regime"], row["rounding"], flush=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


if __name__ == "__main__":
    main()
