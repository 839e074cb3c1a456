"""Scenes that break a rule each, made from one good triangle."""

import base64
import copy
import json
import struct

INPUT = 42

POSITIONS = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
INDICES = struct.pack("<3H", 0, 1, 2)
BUFFER = POSITIONS + INDICES + b"\0\0"
# The same triangle by Draco's sequential encoder; its one attribute has the id 0.
DRACO = bytes.fromhex("445241434f02020100000001030100010201010009030000000000000000000000000000000000803f"
                      "0000000000000000000000000000803f00000000")


def good():
    return {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(BUFFER)}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0],
                       "max": [1, 1, 0]},
                      {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}],
    }


def glb(root, buffer=BUFFER):
    text = json.dumps(root).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(buffer), 0x004E4942) + buffer
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


class Case:
    """A good scene with `change` done to it; `bytes_change` to the file's bytes; `needs`: what the sentence says."""

    def __init__(self, name, change=None, bytes_change=None, rc=INPUT, needs="", buffer=BUFFER, suffix="glb"):
        self.name, self.rc, self.needs = name, rc, needs
        self.change, self.bytes_change, self.buffer, self.suffix = change, bytes_change, buffer, suffix

    def write(self, folder):
        root = copy.deepcopy(good())
        if self.change:
            self.change(root)
        if self.suffix == "gltf":
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.buffer).decode()
            root["buffers"][0].setdefault("uri", uri)
            data = json.dumps(root).encode()
        else:
            data = glb(root, self.buffer)
        path = folder / f"bad.{self.suffix}"
        path.write_bytes(self.bytes_change(data) if self.bytes_change else data)
        return path


def put(pointer, value):
    """A change of one field: put("accessors/0/count", 7)."""
    *way, last = pointer.split("/")

    def change(root):
        at = root
        for key in way:
            at = at[int(key) if key.isdigit() else key]
        at[int(last) if last.isdigit() else last] = value
    return change


def cycle(root):
    root["nodes"] = [{"mesh": 0, "children": [1]}, {"children": [0]}]


def draco(attribute_id, buffer):
    def change(root):
        root["buffers"][0]["byteLength"] = root["bufferViews"][0]["byteLength"] = len(buffer)
        root["extensionsUsed"] = root["extensionsRequired"] = ["KHR_draco_mesh_compression"]
        root["meshes"][0]["primitives"][0]["extensions"] = {
            "KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": attribute_id}}}
    return change


def extension(root):
    root["extensionsUsed"] = root["extensionsRequired"] = ["VENDOR_unknown"]


def draw_mode(mode):
    return put("meshes/0/primitives/0/mode", mode)


NAN = struct.pack("<f", float("nan"))

CASES = [
    Case("GLB cut in its header", bytes_change=lambda data: data[:10]),
    Case("GLB cut in its JSON", bytes_change=lambda data: data[:60]),
    Case("GLB cut in its buffer", bytes_change=lambda data: data[:-20]),
    Case("empty file", bytes_change=lambda data: b""),
    Case("text that is no JSON", bytes_change=lambda data: data[:100], suffix="gltf"),
    Case("accessor past its view", put("accessors/0/count", 4), needs="accessors[0]"),
    Case("view past its buffer", put("bufferViews/0/byteLength", 4000)),
    Case("buffer longer than its data", put("buffers/0/byteLength", 100_000)),
    Case("index past its vertices", buffer=POSITIONS + struct.pack("<3H", 0, 1, 9) + b"\0\0"),
    Case("negative index of a mesh", put("nodes/0/mesh", -1)),
    Case("mesh that is not there", put("nodes/0/mesh", 5)),
    Case("node cycle", cycle),
    Case("count of 2^40", put("accessors/0/count", 1 << 40), needs="accessors[0].count"),
    Case("count of 2^40 without a view",
         lambda root: (put("accessors/0/count", 1 << 40)(root), root["accessors"][0].pop("bufferView"))),
    Case("positions of a wrong type", put("accessors/0/type", "SCALAR")),
    Case("Draco data that is none", draco(0, BUFFER), needs="no Draco header"),
    Case("Draco attribute id that is not there", draco(99, DRACO), needs="no attribute 99", buffer=DRACO),
    Case("unknown required extension", extension, needs="VENDOR_unknown"),
    Case("buffer that is not there", put("buffers/0/uri", "none.bin"), suffix="gltf"),
    Case("scene without nodes", put("scenes/0/nodes", []), rc=INPUT),
    Case("scene of points only", draw_mode(0)),
    Case("scene of one degenerate triangle", buffer=POSITIONS[:24] + POSITIONS[:12] + INDICES + b"\0\0"),
    Case("scene of NaN", buffer=NAN * 9 + INDICES + b"\0\0"),
    Case("matrix of infinities", put("nodes/0/scale", [1e39, 1e39, 1e39])),
]
