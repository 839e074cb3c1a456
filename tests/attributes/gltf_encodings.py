"""A scene's vertex attributes written in other ways that give the same numbers: sparse, or EXT_meshopt_compression.

What comes is a .gltf whose accessors have a view each and whose one buffer lies beside it, as made_scene.Scene writes.
"""

import ctypes
import json

import numpy as np

COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Rewriter:
    def __init__(self, path):
        self.path, self.document = path, json.loads(path.read_text())
        self.data = bytearray((path.parent / self.document["buffers"][0]["uri"]).read_bytes())

    def attributes(self):
        """The accessors of vertices, each once."""
        return sorted({index for mesh in self.document["meshes"] for primitive in mesh["primitives"]
                       for index in primitive["attributes"].values()})

    def rows(self, accessor):
        kind, width = COMPONENTS[accessor["componentType"]], WIDTHS[accessor["type"]]
        view = self.document["bufferViews"][accessor["bufferView"]]
        data = bytes(self.data[view["byteOffset"]:view["byteOffset"] + view["byteLength"]])
        return np.frombuffer(data, kind, accessor["count"] * width).reshape(-1, width)

    def view(self, data, **fields):
        self.data += bytes(-len(self.data) % 4)
        self.document["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data),
                                             **fields})
        self.data += data
        return len(self.document["bufferViews"]) - 1

    def write(self, name):
        path = self.path.with_name(f"{name}.gltf")
        self.document["buffers"][0] = {"uri": f"{name}.bin", "byteLength": len(self.data)}
        path.with_suffix(".bin").write_bytes(self.data)
        path.write_text(json.dumps(self.document))
        return path


def sparse(path, name="sparse"):
    """Every third row stands in the sparse part, and noise in its place; of some accessors all do, without a view."""
    scene, random = Rewriter(path), np.random.default_rng(4)
    for number, index in enumerate(scene.attributes()):
        accessor = scene.document["accessors"][index]
        rows = scene.rows(accessor)
        some = np.arange(0, len(rows), 1 if number % 4 == 3 else 3)
        kind = [np.uint8, np.uint16, np.uint32][number % 3]
        kind = kind if len(rows) <= np.iinfo(kind).max else np.uint32
        if number % 4 == 3:
            del accessor["bufferView"]
        else:
            noise = rows.copy()
            noise[some] = random.integers(1, 100, (len(some), rows.shape[1]))
            accessor["bufferView"] = scene.view(noise.tobytes())
        accessor["sparse"] = {
            "count": len(some),
            "indices": {"bufferView": scene.view(some.astype(kind).tobytes()),
                        "componentType": {np.uint8: 5121, np.uint16: 5123, np.uint32: 5125}[kind]},
            "values": {"bufferView": scene.view(rows[some].tobytes())}}
    return scene.write(name)


class Meshopt:
    """The encoders of the library that the import decodes with."""

    def __init__(self):
        self.library = ctypes.CDLL("libmeshoptimizer.so")
        for call in ("meshopt_encodeVertexBufferBound", "meshopt_encodeVertexBuffer"):
            getattr(self.library, call).restype = ctypes.c_size_t

    def vertices(self, rows):
        """(count, stride) bytes as a stream."""
        count, stride = (ctypes.c_size_t(size) for size in rows.shape)
        out = ctypes.create_string_buffer(self.library.meshopt_encodeVertexBufferBound(count, stride))
        size = self.library.meshopt_encodeVertexBuffer(out, ctypes.c_size_t(len(out)), rows.tobytes(), count, stride)
        return out.raw[:size]

    def octahedral(self, vectors, kind):
        """(what is stored, what it decodes to) of unit vectors, four numbers of int8 or int16 each."""
        vectors = np.ascontiguousarray(np.pad(vectors, ((0, 0), (0, 1))), np.float32)
        stored = np.zeros((len(vectors), 4), kind)
        size, bits = ctypes.c_size_t(stored.itemsize * 4), ctypes.c_int(8 * stored.itemsize)
        pointer = stored.ctypes.data_as(ctypes.c_void_p)
        self.library.meshopt_encodeFilterOct(pointer, ctypes.c_size_t(len(vectors)), size, bits,
                                             vectors.ctypes.data_as(ctypes.c_void_p))
        decoded = stored.copy()
        self.library.meshopt_decodeFilterOct(decoded.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(len(vectors)),
                                             size)
        return stored, decoded


def meshopt(path):
    """(the scene compressed, the same numbers plain): normals of integers by the octahedral filter."""
    encoder, packed, plain = Meshopt(), Rewriter(path), Rewriter(path)
    packed.document["extensionsUsed"].append("EXT_meshopt_compression")
    packed.document["extensionsRequired"] = ["EXT_meshopt_compression"]
    packed.document["buffers"].append({"byteLength": 1 << 24,
                                       "extensions": {"EXT_meshopt_compression": {"fallback": True}}})
    normals = {primitive["attributes"].get("NORMAL") for mesh in packed.document["meshes"]
               for primitive in mesh["primitives"]}
    for index in packed.attributes():
        accessor = packed.document["accessors"][index]
        rows, filtered = packed.rows(accessor), {}
        if index in normals and rows.dtype != np.float32:
            length = np.linalg.norm(rows.astype(np.float64), axis=1)[:, None]
            rows, decoded = encoder.octahedral(rows / length, rows.dtype)
            decoded_view = plain.view(decoded.tobytes(), byteStride=4 * rows.itemsize)
            plain.document["accessors"][index]["bufferView"] = decoded_view
            filtered = {"filter": "OCTAHEDRAL"}
        data = rows.view(np.uint8).reshape(len(rows), -1)
        data = np.pad(data, ((0, 0), (0, -data.shape[1] % 4)))
        count, stride = data.shape
        stream = packed.view(encoder.vertices(data))
        accessor["bufferView"] = len(packed.document["bufferViews"])
        packed.document["bufferViews"].append({
            "buffer": 1, "byteLength": count * stride, "byteStride": stride,
            "extensions": {"EXT_meshopt_compression": {
                **packed.document["bufferViews"][stream], "byteStride": stride, "count": count, "mode": "ATTRIBUTES",
                **filtered}}})
    return packed.write("meshopt"), plain.write("decoded")
