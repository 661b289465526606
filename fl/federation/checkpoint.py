"""The state of a federation as bytes and back, exactly.

A line of JSON, then the arrays in the .npy format, one after the other; nothing is pickled. The
same state gives the same bytes.
"""

import io
import json

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from fl.arrays import frozen
from fl.errors import CheckpointError
from fl.federation.community import Federation
from fl.federation.state import FederationState, Pending
from fl.training.local import LocalResult

FORMAT = 2


def to_bytes(federation: Federation, state: FederationState) -> bytes:
    """The whole state; a few times the size of the models."""
    arrays: dict[str, NDArray[np.generic]] = {
        "eps_history": state.eps_history,
        "eps_received": state.eps_received,
        "cov": state.cov,
        "missed": state.missed,
    }
    for index, model in enumerate(state.models):
        arrays[f"model/{index}"] = model
        arrays[f"correct/{index}"] = state.correct[index]
        arrays[f"reported/{index}"] = state.reported[index]
        if state.buffers[index].size:
            arrays[f"buffers/{index}"] = state.buffers[index]
        for key, value in state.algorithm[index].items():
            arrays[f"algorithm/{index}/{key}"] = value
        for device, made in state.pending[index].items():
            result = made.result
            arrays[f"pending/{index}/{device}"] = np.stack((made.start, result.model))
            told = np.array((made.begun, result.steps, result.loss), dtype=np.float64)
            arrays[f"told/{index}/{device}"] = told
            if made.correction is not None:
                arrays[f"correction/{index}/{device}"] = made.correction
    header = {
        "format": FORMAT,
        "rounds": state.rounds,
        "federation": federation.fingerprint,
        "arrays": list(arrays),
    }
    out = io.BytesIO()
    out.write(json.dumps(header).encode() + b"\n")
    for array in arrays.values():
        npy.write_array(out, np.ascontiguousarray(array), allow_pickle=False)
    return out.getvalue()


def from_bytes(federation: Federation, data: bytes) -> FederationState:
    """The state that `to_bytes` wrote for the same federation; `CheckpointError` otherwise."""
    source = io.BytesIO(data)
    try:
        header = json.loads(source.readline())
        if header["format"] != FORMAT:
            raise CheckpointError(f"format {header['format']}, this program reads {FORMAT}")
        if header["federation"] != federation.fingerprint:
            raise CheckpointError("written with other data, devices, networks or algorithm")
        arrays: dict[str, NDArray[np.generic]] = {}
        for key in header["arrays"]:
            arrays[key] = frozen(npy.read_array(source, allow_pickle=False))
        rounds = int(header["rounds"])
        count = len(federation.communities)
        return FederationState(
            rounds=rounds,
            models=tuple(arrays[f"model/{i}"].astype(np.float32, copy=False) for i in range(count)),
            algorithm=tuple(
                {
                    key.removeprefix(f"algorithm/{i}/"): value.astype(np.float32, copy=False)
                    for key, value in arrays.items()
                    if key.startswith(f"algorithm/{i}/")
                }
                for i in range(count)
            ),
            eps_history=arrays["eps_history"].astype(np.float64, copy=False),
            eps_received=arrays["eps_received"].astype(np.float64, copy=False),
            cov=arrays["cov"].astype(np.float64, copy=False),
            missed=arrays["missed"].astype(np.bool_, copy=False),
            correct=tuple(
                arrays[f"correct/{i}"].astype(np.int64, copy=False) for i in range(count)
            ),
            reported=tuple(
                arrays[f"reported/{i}"].astype(np.int64, copy=False) for i in range(count)
            ),
            buffers=tuple(
                arrays[f"buffers/{i}"].astype(np.float32, copy=False)
                if f"buffers/{i}" in arrays
                else np.empty((0, community.network.buffers), dtype=np.float32)
                for i, community in enumerate(federation.communities)
            ),
            pending=tuple(
                {
                    device: _pending(
                        arrays[key],
                        arrays[f"told/{i}/{device}"],
                        arrays.get(f"correction/{i}/{device}"),
                    )
                    for key in arrays
                    if key.startswith(f"pending/{i}/")
                    for device in (int(key.rpartition("/")[2]),)
                }
                for i in range(count)
            ),
        )
    except (ValueError, KeyError, TypeError, EOFError) as error:
        raise CheckpointError(f"damaged: {error!r}") from error


def _pending(
    vectors: NDArray[np.generic],
    told: NDArray[np.generic],
    correction: NDArray[np.generic] | None,
) -> Pending:
    """What a device had made when the state was written."""
    start, model = vectors.astype(np.float32, copy=False)
    begun, steps, loss = told.astype(np.float64).tolist()
    added = None if correction is None else correction.astype(np.float32, copy=False)
    return Pending(int(begun), start, LocalResult(model, int(steps), loss), added)
