"""`fitball plan FIT`: what to measure next."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitball.cli.options import count, pairs, place, whole

HELP = "what to measure next: the impacts and sensors that would tell most"
DESCRIPTION = """What to measure next, from the posterior of a fit.

Every incident state that your machine can make is looked at: how much one more impact there is expected to tell
(in nats) of what you want to know, noise and all other parameters as uncertain as the fit left them. The best
impacts are chosen one after the other, and other ways of measuring are set beside measuring as before."""
EXAMPLE = """examples:
  fitball plan fits/wang_all/two-mass --speed 5:20 --angle 10:80 --spin -300:300
  fitball plan fits/wang_all/two-mass --for k_theta,mu --impacts 8
  fitball plan fits/wang_all/two-mass --for "court pace" --sensor contact_time=0.1ms --sensor camera=0.3
  fitball plan fits/wang_all/two-mass --for impact="v=30 m/s, theta=16 deg" --cost camera=3 --cost contact_time=2

A sensor is COLUMN=SD (a column of a table, read with that sd beside or instead of the fitted ones), camera=SHARE
(all columns with that share of their fitted noise), force=SD (a force plate of that noise, 20,000 samples a second),
drop=HEIGHT (a drop test from there), several of them joined by commas, or none. Without --sensor a contact timer, a
force plate, a camera twice as good and the ITF's drop test are looked at, as far as the model knows of them.
Results go to the folder plan beside fit.json unless --out names another."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("fit", metavar="FIT", help="a result folder of fitball calibrate, or its fit.json")
    parser.add_argument(
        "--for", dest="target", metavar="TARGET",
        help='what is to be known: parameters (k_theta,mu), "court pace", or impact="v=30 m/s, theta=16 deg" '
        "(default: all parameters of the model)",
    )  # fmt: skip
    for name, unit, example in (("speed", "m/s", "5:20"), ("angle", "deg", "10:80"), ("spin", "rad/s", "-300:300")):
        parser.add_argument(
            f"--{name}", metavar="LOW:HIGH",
            help=f"what the machine can do, in {unit} or with a unit, e.g. {example} (LOW:HIGH:STEPS, or one value; "
            "default: the range of the fitted table)",
        )  # fmt: skip
    parser.add_argument("--impacts", type=count, default=5, metavar="N", help="impacts to choose (default 5)")
    parser.add_argument("--repeats", type=count, default=1, metavar="N", help="times each is made (default 1)")
    parser.add_argument(
        "--sensor", metavar="NAME=VALUE", action="append", help="another way of measuring, see below; repeatable"
    )
    parser.add_argument(
        "--cost", metavar="NAME=C", action="append", default=[],
        help="what an impact read by that sensor costs, one measured as before being 1: the batch is then chosen "
        "among all sensors by gain for cost; repeatable",
    )  # fmt: skip
    parser.add_argument("--seed", type=whole, default=1, metavar="N", help="seed of all random numbers (default 1)")
    parser.add_argument("--out", type=place, metavar="DIR", help="result folder (default: plan, beside fit.json)")
    parser.add_argument("--overwrite", action="store_true", help="replace an older plan in the folder")
    parser.add_argument("--json", action="store_true", help="print plan.json (SI units, angles in radians)")
    parser.add_argument("--quiet", action="store_true", help="no progress, no tables: only errors and the folder")


def run(args: argparse.Namespace) -> int:
    """Plan, write the folder, print what to do."""
    cost = pairs("--cost", args.cost, float, "NAME=C, such as contact_time=2", "a number", last=True)
    args.progress("loading", None)
    from fitball.api import load_fit
    from fitball.report.form.files import json_text

    place = Path(args.fit)
    folder = Path(args.out) if args.out else (place.parent if place.is_file() else place) / "plan"
    made = load_fit(place).plan(
        args.target, speed=args.speed, angle=args.angle, spin=args.spin, impacts=args.impacts, repeats=args.repeats,
        sensors=args.sensor, cost=cost, seed=args.seed, progress=args.progress,
    )  # fmt: skip
    args.progress("figure and files", None)
    made.save(folder, overwrite=args.overwrite, command=args.command)
    args.progress.finish()
    if args.json:
        print(json_text(made.json()), end="")
    else:
        print(folder if args.quiet else made.report(folder))
    return 0
