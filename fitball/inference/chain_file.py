"""The chain on disk: one group an ensemble in emcee's own HDF layout, written whole and renamed into place.

`emcee.backends.HDFBackend(path, name="ensemble_0", read_only=True)` reads each group. Walkers are stored in
the coordinates of the priors (attribute `coordinates`), with the state of the random generator, so that a run goes
on exactly where it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import emcee
import h5py
import numpy as np

from fitball.errors import ResultFolderError
from fitball.values import FloatArray

GROUP = "ensemble_{}"


@dataclass(frozen=True)
class EnsembleChain:
    """Steps of one ensemble: `chain` (steps, walkers, free), `log_posterior` (steps, walkers), `accepted`
    (walkers,) and the generator's state after the last step.
    """

    chain: FloatArray
    log_posterior: FloatArray
    accepted: FloatArray
    random_state: tuple[Any, ...]


@dataclass(frozen=True)
class ChainFile:
    """Where a run keeps its chains; `fingerprint` names everything that must be the same for a run to go on."""

    path: Path
    fingerprint: str

    def write(self, ensembles: Sequence[EnsembleChain], names: Sequence[str], logs: Sequence[bool]) -> None:
        """Write all chains to a temporary file and rename it.

        Raises ResultFolderError when the folder cannot be written.
        """
        temporary = self.path.with_name(self.path.name + ".partial")
        try:
            with h5py.File(temporary, "w") as file:
                file.attrs["fingerprint"] = self.fingerprint
                file.attrs["parameters"] = json.dumps(list(names))
                file.attrs["coordinates"] = json.dumps(["ln" if log else "value" for log in logs])
                for k, item in enumerate(ensembles):
                    _write_group(file.create_group(GROUP.format(k)), item)
            temporary.replace(self.path)
        except OSError as error:
            raise ResultFolderError(f"{self.path}: the chain cannot be written: {error}") from None

    def read(self) -> list[EnsembleChain]:
        """The chains of an earlier run.

        Raises ResultFolderError when there is none, when it is damaged, or when it belongs to another problem.
        """
        if not self.path.exists():
            raise ResultFolderError(f"{self.path}: no chain to resume; run without --resume")
        found, groups = read_chains(self.path)
        if found != self.fingerprint:
            raise ResultFolderError(
                f"{self.path}: this chain was sampled from another problem (table, scene, model, priors, seed or "
                "version of fitball differ); use --overwrite to start anew, or another --out"
            )
        return groups


def read_chains(path: Path) -> tuple[str, list[EnsembleChain]]:
    """The fingerprint of a chain file and its chains, whatever problem they belong to.

    Raises ResultFolderError when it is damaged.
    """
    try:
        with h5py.File(path, "r") as file:
            return str(file.attrs["fingerprint"]), [_read_group(file[GROUP.format(k)]) for k in range(len(file))]
    except (OSError, KeyError) as error:
        raise ResultFolderError(f"{path}: not a chain of fitball, or damaged: {error}") from None


def _write_group(group: h5py.Group, item: EnsembleChain) -> None:
    steps, walkers, dimension = item.chain.shape
    group.attrs["version"] = emcee.__version__
    group.attrs["nwalkers"] = walkers
    group.attrs["ndim"] = dimension
    group.attrs["has_blobs"] = False
    group.attrs["iteration"] = steps
    for k, part in enumerate(item.random_state):
        group.attrs[f"random_state_{k}"] = part
    group.create_dataset("chain", data=item.chain, maxshape=(None, walkers, dimension))
    group.create_dataset("log_prob", data=item.log_posterior, maxshape=(None, walkers))
    group.create_dataset("accepted", data=item.accepted)


def _read_group(group: h5py.Group) -> EnsembleChain:
    count = sum(key.startswith("random_state_") for key in group.attrs)
    state = tuple(group.attrs[f"random_state_{k}"] for k in range(count))
    return EnsembleChain(np.array(group["chain"]), np.array(group["log_prob"]), np.array(group["accepted"]), state)
