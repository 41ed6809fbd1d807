"""The chain on disk: one group an ensemble in emcee's own HDF layout, written whole or not at all.

`emcee.backends.HDFBackend(path, name="ensemble_0", read_only=True)` reads each group. Walkers are stored in
the coordinates of the priors (attribute `coordinates`), with the state of the random generator, so that a run goes
on exactly where it stopped.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fitball.data.hdf5_arrays import array, finite, group, opened
from fitball.errors import ResultFolderError
from fitball.files import write_whole
from fitball.inference.sampling.emcee_package import emcee
from fitball.values import FloatArray
from fitball.wording import option

GROUP = "ensemble_{}"


@dataclass(frozen=True)
class Going:
    """What a chain of which not every step is kept needs to go on: the number of `steps` made, the `stride` of those
    kept after the warm-up, where the walkers are (walkers, free) with their log posterior (walkers,), and for each
    step at which a check did not suffice the next such step.
    """

    steps: int
    stride: int
    coordinates: FloatArray
    log_posterior: FloatArray
    checks: Mapping[int, int]


@dataclass(frozen=True)
class EnsembleChain:
    """Steps of one ensemble: `chain` (steps, walkers, free), `log_posterior` (steps, walkers), `accepted`
    (walkers,) and the generator's state after the last step; `going` where some steps are not kept.
    """

    chain: FloatArray
    log_posterior: FloatArray
    accepted: FloatArray
    random_state: tuple[Any, ...]
    going: Going | None = None

    @property
    def now(self) -> Going:
        """Where it stopped, whether or not all steps are kept."""
        return self.going or Going(len(self.chain), 1, self.chain[-1], self.log_posterior[-1], {})


@dataclass(frozen=True)
class ChainFile:
    """Where a run keeps its chains; `fingerprint` names everything that must be the same for a run to go on."""

    path: Path
    fingerprint: str

    def write(self, ensembles: Sequence[EnsembleChain], names: Sequence[str], logs: Sequence[bool]) -> None:
        """Write all chains; where that fails those of an earlier step stay. Raises ResultFolderError."""
        made = io.BytesIO()
        with h5py.File(made, "w") as file:
            file.attrs["fingerprint"] = self.fingerprint
            file.attrs["sha256"] = digest(ensembles)
            file.attrs["parameters"] = json.dumps(list(names))
            file.attrs["coordinates"] = json.dumps(["ln" if log else "value" for log in logs])
            for k, ensemble in enumerate(ensembles):
                _write_group(file.create_group(GROUP.format(k)), ensemble)
        write_whole(self.path, [made.getbuffer()])

    def read(self, ensembles: int, walkers: int, names: Sequence[str]) -> list[EnsembleChain]:
        """The chains of an earlier run over the parameters `names`.

        Raises ResultFolderError when there is none, when it is damaged, or when it belongs to another problem.
        """
        if not self.path.exists():
            raise ResultFolderError(f"{self.path}: no chain to resume; run without {option('resume')}")
        fingerprint, kept, groups = read_chains(self.path)
        if fingerprint != self.fingerprint:
            raise ResultFolderError(
                f"{self.path}: this chain belongs to another problem: table, scene, model, priors, seed or "
                f"version of fitball differ. Use {option('overwrite')} to start anew, or another folder"
            )
        expected = (ensembles, walkers, len(names))
        read = (len(groups), *groups[0].chain.shape[1:])
        if read != expected or digest(groups) != kept:
            raise ResultFolderError(
                f"{self.path}: damaged: read {read} ensembles, walkers and parameters with SHA-256 {digest(groups)}, "
                f"expected {expected} with {kept[:64] or 'a digest, which older fitballs did not write'}; use "
                f"{option('overwrite')} to start anew"
            )
        return groups


def digest(ensembles: Sequence[EnsembleChain]) -> str:
    """SHA-256 over all steps and states: a chain that goes on must be the one that stopped, to the last bit."""
    hashed = sha256()
    for ensemble in ensembles:
        key = np.asarray(ensemble.random_state[1])
        for numbers in (ensemble.chain, ensemble.log_posterior, ensemble.accepted, key):
            hashed.update(f"{numbers.shape}\n".encode())
            hashed.update(np.ascontiguousarray(numbers).tobytes())
        if ensemble.going is not None:
            going = ensemble.going
            hashed.update(f"{going.steps} {going.stride} {sorted(going.checks.items())}\n".encode())
            hashed.update(np.ascontiguousarray(going.coordinates).tobytes())
            hashed.update(np.ascontiguousarray(going.log_posterior).tobytes())
        position, has_normal, normal = ensemble.random_state[2:]
        hashed.update(f"{int(position)} {int(has_normal)} {float(normal)!r}\n".encode())
    return hashed.hexdigest()


def read_chains(path: Path) -> tuple[str, str, list[EnsembleChain]]:
    """The fingerprint of a chain file, the digest it states ("" for none), and its chains, whatever problem they
    belong to.

    Raises ResultFolderError when it is damaged.
    """
    with opened(path, "the chain of a fit") as file:
        first = finite(group(file, GROUP.format(0)), "chain", (None, None, None))
        chains = [_read_group(group(file, GROUP.format(k)), first.shape[1:]) for k in range(len(file))]
        return str(file.attrs["fingerprint"]), str(file.attrs.get("sha256", "")), chains


def _write_group(group: h5py.Group, ensemble: EnsembleChain) -> None:
    steps, walkers, dimension = ensemble.chain.shape
    group.attrs["version"] = emcee.__version__
    group.attrs["nwalkers"] = walkers
    group.attrs["ndim"] = dimension
    group.attrs["has_blobs"] = False
    group.attrs["iteration"] = steps
    for k, part in enumerate(ensemble.random_state):
        group.attrs[f"random_state_{k}"] = part
    group.create_dataset("chain", data=ensemble.chain, maxshape=(None, walkers, dimension))
    group.create_dataset("log_prob", data=ensemble.log_posterior, maxshape=(None, walkers))
    group.create_dataset("accepted", data=ensemble.accepted)
    if ensemble.going is not None:
        going = group.create_group("going")
        going.attrs["steps"], going.attrs["stride"] = ensemble.going.steps, ensemble.going.stride
        going.create_dataset("coordinates", data=ensemble.going.coordinates)
        going.create_dataset("log_prob", data=ensemble.going.log_posterior)
        going.create_dataset("checks", data=np.array(sorted(ensemble.going.checks.items()), dtype=np.int64))


def _read_group(part: h5py.Group, shape: tuple[int, int]) -> EnsembleChain:
    """A chain of `shape` (walkers, free) for every step. Raises ValueError."""
    chain = finite(part, "chain", (None, *shape))
    count = sum(key.startswith("random_state_") for key in part.attrs)
    state = tuple(part.attrs[f"random_state_{k}"] for k in range(count))
    if not _is_state(state):
        raise ValueError(f"{part.name}: its random_state is not the state of a Mersenne twister")
    going = _read_going(group(part, "going"), shape) if "going" in part else None
    return EnsembleChain(
        chain, finite(part, "log_prob", (len(chain), shape[0])), finite(part, "accepted", shape[:1]), state, going
    )


def _read_going(part: h5py.Group, shape: tuple[int, int]) -> Going:
    """Raises ValueError."""
    steps, stride = (int(part.attrs[name]) for name in ("steps", "stride"))
    if stride < 2 or steps < stride:
        raise ValueError(f"{part.name}: read {steps} steps of which one in {stride} is kept")
    checks = array(part, "checks", (None, 2), "iu")
    coordinates, log_posterior = finite(part, "coordinates", shape), finite(part, "log_prob", shape[:1])
    return Going(steps, stride, coordinates, log_posterior, {int(at): int(after) for at, after in checks})


def _is_state(state: tuple[Any, ...]) -> bool:
    """Whether numpy can go on from it: a position beyond the key would be taken unseen, and read past its end."""
    if len(state) != 5:
        return False
    name, key, position, has_normal, normal = state
    if not (isinstance(key, np.ndarray) and key.shape == (624,) and key.dtype == np.uint32):
        return False
    whole = all(isinstance(number, np.integer) for number in (position, has_normal))
    known = isinstance(name, str) and name == "MT19937" and isinstance(normal, np.floating) and np.isfinite(normal)
    return bool(whole and known and 0 <= position <= 624 and has_normal in (0, 1))
