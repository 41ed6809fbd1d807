"""What the verbs that fit are asked in the same words: model, priors, structure, effort."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from fitball.cli.options import add_cores, add_reading, add_structure, count, pairs, whole

if TYPE_CHECKING:
    from fitball.inference.effort import Effort
    from fitball.inference.problem.problem import Choices


def add_fitting(parser: argparse.ArgumentParser) -> None:
    """Add what a fit may be asked, of one table or of many."""
    parser.add_argument("--model", metavar="NAME", help="{ranked}")
    parser.add_argument(
        "--closure", metavar="NAME=OPTION", action="append", default=[], help="replace a closure, e.g. normal=total"
    )
    parser.add_argument("--config", metavar="FILE.toml", help="scene file (default: the .toml beside DATA)")
    parser.add_argument(
        "--fix", metavar="NAME=VALUE", action="append", default=[], help="hold a parameter (SI units)"
    )
    parser.add_argument(
        "--prior",
        metavar="NAME=DIST(...)",
        action="append",
        default=[],
        help='e.g. "mu=normal(0.6, 0.1)", or one from the literature: mu=literature:clay (fitball datasets priors)',
    )
    add_structure(parser)
    add_reading(parser)
    parser.add_argument("--point-only", action="store_true", help="no posterior: the best values only")
    parser.add_argument("--seed", type=whole, default=1, metavar="N", help="seed of all random numbers (default 1)")
    parser.add_argument("--max-steps", type=count, metavar="N", help="steps of each ensemble at most (default 20000)")
    parser.add_argument(
        "--walkers", type=count, metavar="N", help="walkers of each ensemble (default 4 per parameter)"
    )
    add_cores(parser)


def choices_of(args: argparse.Namespace) -> Choices:
    """The choices that the options ask for. Raises ParameterError."""
    from fitball.inference.problem.problem import Choices

    return Choices(
        model=args.model,
        closures=pairs("--closure", args.closure, str),
        priors=pairs("--prior", args.prior, str),
        fix=pairs("--fix", args.fix, float),
        noise=args.noise,
        pool=pairs("--pool", args.pool, str),
        offsets=args.offsets,
        incident_errors=not args.exact_incidence,
        velocity_noise=args.velocity_noise,
    )


def make_effort(args: argparse.Namespace, cores: int) -> Effort:
    """The effort the options ask for, with so many threads."""
    from fitball.inference.effort import MAX_STEPS, Effort

    return Effort(
        seed=args.seed,
        point_only=args.point_only,
        walkers=args.walkers,
        max_steps=MAX_STEPS if args.max_steps is None else args.max_steps,
        cores=cores,
    )
