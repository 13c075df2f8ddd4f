"""What became of the light: the `trace` summary."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from skinrender.engine.ledger import Ledger
from skinrender.transport import tally

FRACTIONS = {
    "reflectance": tally.REFLECTED,
    "specular": tally.SPECULAR,
    "transmittance": tally.TRANSMITTED,
    "sides": tally.SIDES,
    "reflectance_unscattered": tally.REFLECTED_UNSCATTERED,
    "transmittance_unscattered": tally.TRANSMITTED_UNSCATTERED,
}


@dataclass(frozen=True, eq=False)
class TraceSummary:
    """Fractions of the power aimed at the patch, with standard errors from the rounds; B bands, T tally columns.

    Parameters
    ----------
    wavelength_nm : (B,).
    layer_name : names of the tissue layers, top to bottom.
    counts : (B, T) i8, sums over the rounds; columns of `transport.tally`.
    fractions, fractions_stderr : (B, T) by band.
    total, total_stderr : (T,) all bands, weighted by the light's power in each.
    rounds, stored : how many.
    seconds : by stage.
    """

    wavelength_nm: np.ndarray
    layer_name: tuple[str, ...]
    counts: np.ndarray
    fractions: np.ndarray
    fractions_stderr: np.ndarray
    total: np.ndarray
    total_stderr: np.ndarray
    rounds: int
    stored: int
    seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def emitted(self) -> int:
        return int(self.counts[:, tally.EMITTED].sum())

    @property
    def lost(self) -> int:
        return int(self.counts[:, tally.LOST].sum())

    def as_json(self) -> dict[str, Any]:
        """The object that ``skinrender trace --json`` prints."""
        return {
            **self._fractions(self.total, self.total_stderr),
            "photons_emitted": self.emitted,
            "photons_stored": self.stored,
            "lost": self.lost,
            "rounds": self.rounds,
            "null_collisions": int(self.counts[:, tally.COLLISIONS_NULL].sum()),
            "by_wavelength": [
                {
                    "wavelength_nm": float(wavelength),
                    "photons_emitted": int(self.counts[band, tally.EMITTED]),
                    **self._fractions(self.fractions[band], self.fractions_stderr[band]),
                }
                for band, wavelength in enumerate(self.wavelength_nm)
            ],
            "seconds": dict(self.seconds),
        }

    def _fractions(self, values: np.ndarray, errors: np.ndarray) -> dict[str, Any]:
        layers = len(self.layer_name)
        pairs = list(zip(values.tolist(), errors.tolist()))
        return {
            **{name: _with_error(*pairs[column]) for name, column in FRACTIONS.items()},
            "absorbed": self._by_layer(pairs[tally.absorbed(layers)]),
            "scattering_events": self._by_layer(pairs[tally.scattered(layers)]),
        }

    def _by_layer(self, pairs: Sequence[tuple[float, float]]) -> dict[str, Any]:
        return {name: _with_error(*pair) for name, pair in zip(self.layer_name, pairs)}


def summarize(
    ledger: Ledger, wavelength_nm: np.ndarray, layer_name: Sequence[str], seconds: Mapping[str, float] | None = None
) -> TraceSummary:
    """Close the books: the summary of all rounds in `ledger`."""
    return TraceSummary(
        np.asarray(wavelength_nm),
        tuple(layer_name),
        ledger.counts,
        ledger.fractions,
        ledger.fractions_stderr,
        ledger.total,
        ledger.total_stderr,
        len(ledger.rounds),
        ledger.stored,
        seconds or {},
    )


def _with_error(value: float, stderr: float) -> dict[str, float | None]:
    return {"value": value, "stderr": None if math.isnan(stderr) else stderr}
