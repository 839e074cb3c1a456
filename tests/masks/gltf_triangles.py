"""Triangles of a glTF scene with what their materials cut out, read by numpy alone, for raymill-mask-reference.

What the reference needs and no more: no Draco, no sparse accessors, no skins, no instancing by extension.
"""

import base64
import json
import math
import pathlib
import struct

import numpy as np

TRIANGLE = np.dtype([("corners", "<f4", (3, 3)), ("tex_coords", "<f4", (3, 2)), ("alphas", "<f4", 3),
                     ("geometry_id", "<u4"), ("primitive_id", "<u4"), ("mask", "<i4"), ("sides", "<u4")])
COMPONENTS = {5120: ("i1", 127), 5121: ("u1", 255), 5122: ("<i2", 32767), 5123: ("<u2", 65535), 5125: ("<u4", 1),
              5126: ("<f4", 1)}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
WRAPS = {10497: 0, 33648: 1, 33071: 2}


class Document:
    def __init__(self, path, folder):
        """`folder`: where pictures that the file holds are written."""
        self.path, self.folder = pathlib.Path(path), folder
        data = self.path.read_bytes()
        self.binary = b""
        if data[:4] == b"glTF":
            length = struct.unpack("<I", data[12:16])[0]
            self.json = json.loads(data[20:20 + length])
            self.binary = data[28 + length:]
        else:
            self.json = json.loads(data)
        self.buffers = [self._bytes(buffer.get("uri")) for buffer in self.json.get("buffers", [])]

    def _bytes(self, uri):
        if uri is None:
            return self.binary
        if uri.startswith("data:"):
            return base64.b64decode(uri.split(",", 1)[1])
        return (self.path.parent / uri).read_bytes()

    def view(self, index):
        view = self.json["bufferViews"][index]
        start = view.get("byteOffset", 0)
        return self.buffers[view["buffer"]][start:start + view["byteLength"]], view.get("byteStride")

    def accessor(self, index):
        """Numbers as float64, integers that are normalised by their range."""
        accessor = self.json["accessors"][index]
        kind, most = COMPONENTS[accessor["componentType"]]
        width, kind = WIDTHS[accessor["type"]], np.dtype(kind)
        data, stride = self.view(accessor["bufferView"])
        stride = stride or width * kind.itemsize
        rows = np.ndarray((accessor["count"], width), kind, data, accessor.get("byteOffset", 0),
                          (stride, kind.itemsize)).astype(np.float64)
        return np.maximum(rows / most, -1) if accessor.get("normalized") else rows

    def image_path(self, index):
        image = self.json["images"][index]
        if "uri" in image and not image["uri"].startswith("data:"):
            return str(self.path.parent / image["uri"])
        data = self._bytes(image["uri"]) if "uri" in image else self.view(image["bufferView"])[0]
        path = self.folder / f"{self.path.stem}-image{index}.{'png' if data[:4] == bytes([137]) + b'PNG' else 'jpg'}"
        path.write_bytes(data)
        return str(path)


def local_matrix(node):
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    n = x * x + y * y + z * z + w * w
    matrix[:3, :3] = np.array([[n - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                               [2 * (x * y + z * w), n - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                               [2 * (x * z - y * w), 2 * (y * z + x * w), n - 2 * (x * x + y * y)]]) / n
    matrix[:3, :3] *= np.array(node.get("scale", (1, 1, 1)))
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def placed_nodes(document):
    """(node, world matrix) in the order of the file's nodes."""
    nodes = document.json["nodes"]
    scenes = document.json.get("scenes")
    roots = scenes[document.json.get("scene", 0)]["nodes"] if scenes else range(len(nodes))
    world, waiting = {}, [(root, np.eye(4)) for root in roots]
    while waiting:
        index, parent = waiting.pop()
        world[index] = parent @ local_matrix(nodes[index])
        waiting += [(child, world[index]) for child in nodes[index].get("children", ())]
    return [(nodes[index], world[index]) for index in sorted(world)]


class Masks:
    """The masks of a document's materials, each once, as bytes for the reference."""

    def __init__(self, document, blend_cutoff, one_side):
        self.document, self.blend_cutoff, self.one_side = document, blend_cutoff, one_side
        self.rows, self.numbers = [], {}

    def of(self, material):
        """(number or -1, TEXCOORD set, map of texture coordinates)"""
        mode = material.get("alphaMode", "OPAQUE")
        if mode == "OPAQUE" or (mode == "BLEND" and self.blend_cutoff is None):
            return -1, None, None
        shading = material.get("pbrMetallicRoughness", {})
        texture = shading.get("baseColorTexture")
        cutoff = self.blend_cutoff if mode == "BLEND" else material.get("alphaCutoff", 0.5)
        factor = shading.get("baseColorFactor", (1, 1, 1, 1))[3]
        path, wraps, coordinates, moved = "", (0, 0), None, np.array([[1, 0, 0], [0, 1, 0]], dtype=np.float64)
        if texture is not None:
            source = self.document.json["textures"][texture["index"]]
            path = self.document.image_path(source["source"])
            sampler = self.document.json["samplers"][source["sampler"]] if "sampler" in source else {}
            wraps = tuple(WRAPS[sampler.get(key, 10497)] for key in ("wrapS", "wrapT"))
            transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
            coordinates = transform.get("texCoord", texture.get("texCoord", 0))
            angle = transform.get("rotation", 0)
            c, s = math.cos(angle), math.sin(angle)
            moved[:, :2] = np.array([[c, s], [-s, c]]) * np.array(transform.get("scale", (1, 1)))
            moved[:, 2] = transform.get("offset", (0, 0))
        row = struct.pack("<I", len(path)) + path.encode() + struct.pack("<ddII", factor, cutoff, *wraps)
        if row not in self.numbers:
            self.numbers[row] = len(self.rows)
            self.rows.append(row)
        return self.numbers[row], coordinates, moved


def primitive_triangles(document, primitive, masks, world):
    positions = document.accessor(primitive["attributes"]["POSITION"])
    indices = (document.accessor(primitive["indices"])[:, 0].astype(np.int64) if "indices" in primitive
               else np.arange(len(positions)))
    indices = indices[:len(indices) // 3 * 3].reshape(-1, 3)
    out = np.zeros(len(indices), TRIANGLE)
    placed = (positions @ world[:3, :3].T + world[:3, 3]).astype(np.float32)
    out["corners"], out["alphas"], out["mask"] = placed[indices], 1, -1
    out["primitive_id"] = np.arange(len(indices))
    material = document.json["materials"][primitive["material"]] if "material" in primitive else {}
    number, coordinates, moved = masks.of(material)
    if number >= 0:
        out["mask"] = number
        if coordinates is not None:
            uv = document.accessor(primitive["attributes"][f"TEXCOORD_{coordinates}"])
            uv = uv[:, :1] * moved[:, 0] + uv[:, 1:2] * moved[:, 1] + moved[:, 2]
            out["tex_coords"] = uv.astype(np.float32)[indices]
        colors = primitive["attributes"].get("COLOR_0")
        if colors is not None and document.json["accessors"][colors]["type"] == "VEC4":
            out["alphas"] = np.clip(document.accessor(colors)[:, 3], 0, 1).astype(np.float32)[indices]
    if masks.one_side and not material.get("doubleSided", False):
        out["sides"] = 1 if np.linalg.det(world[:3, :3]) > 0 else 2
    return out


def read_scene(path, folder, blend_cutoff=None, one_side=False, opaque=False):
    """(triangles, masks): all world triangles by geometry id, degenerate ones too."""
    document = Document(path, folder)
    masks, parts, geometry_id = Masks(document, blend_cutoff, one_side), [], 0
    for node, world in placed_nodes(document):
        if "mesh" not in node:
            continue
        for primitive in document.json["meshes"][node["mesh"]]["primitives"]:
            if primitive.get("mode", 4) == 4 and "POSITION" in primitive["attributes"]:
                part = primitive_triangles(document, primitive, masks, world)
                part["geometry_id"] = geometry_id
                parts.append(part)
            geometry_id += 1
    triangles = np.concatenate(parts)
    if opaque:
        triangles["mask"] = -1
    return triangles, masks.rows


def write_scene(path, triangles, rows):
    with open(path, "wb") as file:
        file.write(struct.pack("<QI", len(triangles), len(rows)))
        file.write(b"".join(rows))
        file.write(triangles.tobytes())
