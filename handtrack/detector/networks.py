"""Networks in TFLite's form, run by OpenCV, which is there anyway, or by LiteRT, which is quicker."""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Axes, Floats, H, W
from handtrack.errors import HandtrackError, unknown_name
from handtrack.parallel import thread_count

Network = Callable[[Floats[H, W, D3]], Mapping[str, Array[*Axes]]]
"""image float32 → outputs by name, without the axis of one image"""
BACKENDS = ("opencv", "litert")
_LITERT = "ai_edge_litert"


def usual_backend() -> str:
    """Return the quicker one where it is installed."""
    return "litert" if find_spec(_LITERT) else "opencv"


def open_network(data: bytes, backend: str, where: str) -> Network:
    """Return a network, to be used by one thread at a time. Raises HandtrackError naming `where` it came from."""
    if backend not in BACKENDS:
        raise unknown_name("backend", backend, BACKENDS)
    if backend == "litert" and not find_spec(_LITERT):
        raise HandtrackError(
            "LiteRT is not installed: `pip install handtrack3d[detector]` brings it; OpenCV does the same, 2.5 times slower."
        )
    try:
        return _by_litert(data) if backend == "litert" else _by_opencv(data)
    except (cv2.error, ValueError, RuntimeError, ImportError) as error:
        said = " ".join(str(error).split())
        raise HandtrackError(f"{where}: {backend} cannot run this network: {said}.") from None


def _by_opencv(data: bytes) -> Network:
    # of OpenCV's two engines the classic one alone gives several outputs, and it is only to be had for files
    engine = getattr(cv2.dnn, "ENGINE_CLASSIC", None)
    with tempfile.TemporaryDirectory(prefix="handtrack_") as folder:
        file = Path(folder) / "network.tflite"
        file.write_bytes(data)
        options = () if engine is None else (engine,)
        network = cv2.dnn.readNetFromTFLite(str(file), *options)
    names = network.getUnconnectedOutLayersNames()

    def run(image: Floats[H, W, D3]) -> Mapping[str, Array[*Axes]]:
        network.setInput(np.ascontiguousarray(image.transpose(2, 0, 1))[None])
        return {name: found[0] for name, found in zip(names, network.forward(names), strict=True)}

    return run


def _by_litert(data: bytes) -> Network:
    interpreter = importlib.import_module(f"{_LITERT}.interpreter").Interpreter(
        model_content=data, num_threads=thread_count()
    )
    interpreter.allocate_tensors()
    given = interpreter.get_input_details()[0]["index"]
    outputs = {row["name"]: row["index"] for row in interpreter.get_output_details()}

    def run(image: Floats[H, W, D3]) -> Mapping[str, Array[*Axes]]:
        interpreter.set_tensor(given, np.ascontiguousarray(image)[None])
        interpreter.invoke()
        return {name: interpreter.get_tensor(index)[0] for name, index in outputs.items()}

    return run
