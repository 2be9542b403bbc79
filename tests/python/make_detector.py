"""Writes the detectors of tests/data/onnx: networks of a few kB that tell the red and the brown body of
tests/data/videos/scene_00011 by their colour alone. `pip install onnx`, then `python make_detector.py tests/data/onnx`.
"""

import json
import sys
from pathlib import Path

import numpy as np
from onnx import TensorProto, checker, helper, numpy_helper, save

LABELS = [
    {"shape": "sphere", "color": "red", "material": "rubber"},
    {"shape": "cylinder", "color": "brown", "material": "metal"},
]
# Red: r - 2 g > 0.12. Brown: g - b > 0.04 and r < 0.45.
UNITS = np.array([[1, -2, 0], [0, 1, -1], [1, 0, 0]], np.float32)
UNIT_BIASES = np.array([-0.12, -0.04, -0.45], np.float32)
SCALE = 100.0


def constant(name, values, kind):
    return numpy_helper.from_array(np.array(values, kind), name)


def colour_logits():
    """1 x 1 convolutions: image [1, 3, H, W] to logits [1, 2, H, W]."""
    # Relu(x) - Relu(-x) = x, so that the second layer also sees the signed units.
    both = np.concatenate([UNITS, -UNITS])[:, :, None, None]
    biases = np.concatenate([UNIT_BIASES, -UNIT_BIASES])
    last = SCALE * np.array([[1, 0, 0, -1, 0, 0], [-4, 1, -4, 0, -1, 0]], np.float32)
    nodes = [
        helper.make_node("Conv", ["image", "units", "unit_biases"], ["linear"]),
        helper.make_node("Relu", ["linear"], ["hidden"]),
        helper.make_node("Conv", ["hidden", "last"], ["logits"]),
    ]
    initial = [
        constant("units", both, np.float32),
        constant("unit_biases", biases, np.float32),
        constant("last", last[:, :, None, None], np.float32),
    ]
    return nodes, initial


def write(folder, name, nodes, initial, size, outputs, contract):
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, *size])
    outputs = [helper.make_tensor_value_info(n, kind, shape) for n, kind, shape in outputs]
    graph = helper.make_graph(nodes, name, [image], outputs, initial)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8, producer_name="vrdp")
    checker.check_model(model, full_check=True)
    save(model, folder / f"{name}.onnx")
    (folder / f"{name}.json").write_text(json.dumps(contract, indent=2) + "\n")


def masks(folder):
    """One map of logits for each label; the features of a pixel are its colour."""
    nodes, initial = colour_logits()
    nodes.append(helper.make_node("Identity", ["image"], ["colour"]))
    outputs = [
        ("logits", TensorProto.FLOAT, [1, 2, "h", "w"]),
        ("colour", TensorProto.FLOAT, [1, 3, "h", "w"]),
    ]
    contract = {
        "output": "masks",
        "names": {"masks": "logits", "features": "colour"},
        "labels": LABELS,
        "least_score": 0.6,
        "least_pixels": 40,
    }
    write(folder, "masks", nodes, initial, ["h", "w"], outputs, contract)


def boxes(folder):
    """One box around all pixels of each label, of an image of 240 x 160 px."""
    width, height = 240, 160
    nodes, initial = colour_logits()
    node = helper.make_node
    initial += [constant("zero", 0, np.float32), constant("one", 1, np.float32)]
    initial += [constant("labels", [0, 1], np.int64)]
    initial += [constant("whole", [width, height, width, height], np.float32), constant("list", [2, 1], np.int64)]
    nodes += [node("ReduceMax", ["logits"], ["columns"], axes=[2], keepdims=0)]
    nodes += [node("ReduceMax", ["logits"], ["rows"], axes=[3], keepdims=0)]
    for line, low, high in [("columns", "left", "right"), ("rows", "top", "bottom")]:
        nodes += [node("Greater", [line, "zero"], [f"{line}_on"])]
        nodes += [node("Cast", [f"{line}_on"], [f"{line}_number"], to=TensorProto.FLOAT)]
        for side, last in [(low, 0), (high, 1)]:
            nodes += [node("ArgMax", [f"{line}_number"], [f"{side}_index"], axis=2, keepdims=0, select_last_index=last)]
            nodes += [node("Cast", [f"{side}_index"], [f"{side}_pixel"], to=TensorProto.FLOAT)]
            if last:
                nodes += [node("Add", [f"{side}_pixel", "one"], [f"{side}_end"])]
            nodes += [node("Reshape", [f"{side}_end" if last else f"{side}_pixel", "list"], [side])]
    sides = ["left", "top", "right", "bottom"]
    nodes += [node("Concat", sides, ["pixels"], axis=1), node("Div", ["pixels", "whole"], ["boxes"])]
    nodes += [node("Sigmoid", ["logits"], ["probabilities"])]
    nodes += [node("ReduceMax", ["probabilities"], ["best"], axes=[0, 2, 3], keepdims=0)]
    nodes += [node("Identity", ["best"], ["scores"]), node("Identity", ["labels"], ["classes"])]
    # Mean colour of the pixels of each label: [2, P] times [P, 3].
    initial += [constant("flat2", [2, width * height], np.int64), constant("flat3", [3, width * height], np.int64)]
    nodes += [node("Reshape", ["probabilities", "flat2"], ["weights"])]
    nodes += [node("Reshape", ["image", "flat3"], ["flat_image"])]
    nodes += [node("Transpose", ["flat_image"], ["pixel_colours"], perm=[1, 0])]
    nodes += [node("MatMul", ["weights", "pixel_colours"], ["sums"])]
    nodes += [node("ReduceSum", ["weights", "last_axis"], ["weight"], keepdims=1)]
    initial += [constant("last_axis", [1], np.int64)]
    nodes += [node("Div", ["sums", "weight"], ["features"])]
    outputs = [
        ("boxes", TensorProto.FLOAT, [2, 4]),
        ("scores", TensorProto.FLOAT, [2]),
        ("classes", TensorProto.INT64, [2]),
        ("features", TensorProto.FLOAT, [2, 3]),
    ]
    contract = {
        "output": "boxes",
        "names": {"boxes": "boxes", "scores": "scores", "labels": "classes", "features": "features"},
        "labels": LABELS,
        "least_score": 0.9,
        "coordinates": "relative",
        "size": None,
    }
    write(folder, "boxes", nodes, initial, [height, width], outputs, contract)


if __name__ == "__main__":
    target = Path(sys.argv[1])
    masks(target)
    boxes(target)
