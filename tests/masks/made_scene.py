"""Scenes of masks that no scene of the collection has: wraps, transforms, alphas of vertices, 16 bits, sides."""

import json
import struct
import zlib

import numpy as np

CLAMP, MIRROR, REPEAT = 33071, 33648, 10497


def write_png(path, pixels):
    """(height, width, channels) of uint8 or uint16; 2 channels are grey and alpha, 4 are RGBA."""
    height, width, channels = pixels.shape
    depth, color = 8 * pixels.dtype.itemsize, {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    rows = pixels.astype(pixels.dtype.newbyteorder(">")).reshape(height, -1).view(np.uint8)
    raw = np.concatenate([np.zeros((height, 1), np.uint8), rows], axis=1).tobytes()

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(raw, 1)) +
                     chunk(b"IEND", b""))


def blobs(random, size, kind, channels):
    """Alpha of smooth blobs, so that there are regions of each sort and borders between them."""
    y, x = np.mgrid[0:size, 0:size] / size * 2 * np.pi
    alpha = sum(random.normal() * np.sin(random.integers(1, 5) * x + random.integers(1, 5) * y + random.random() * 6)
                for _ in range(6))
    alpha = (alpha - alpha.min()) / (alpha.max() - alpha.min())
    pixels = np.zeros((size, size, channels), kind)
    pixels[..., -1] = np.round(alpha * np.iinfo(kind).max)
    return pixels


class Scene:
    def __init__(self, folder, name):
        self.folder, self.name, self.data = folder, name, b""
        self.json = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], "meshes": [], "nodes": [],
                     "materials": [], "textures": [], "images": [], "samplers": [],
                     "extensionsUsed": ["KHR_texture_transform"]}

    def accessor(self, rows, kind, component, normalized=False):
        data = np.ascontiguousarray(rows).tobytes()
        self.data += bytes(-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data
        self.json["accessors"].append({"bufferView": len(self.json["bufferViews"]) - 1, "componentType": component,
                                       "count": len(rows), "type": kind, "normalized": normalized,
                                       "min": np.min(rows, axis=0).tolist() if kind == "VEC3" else None,
                                       "max": np.max(rows, axis=0).tolist() if kind == "VEC3" else None})
        self.json["accessors"][-1] = {k: v for k, v in self.json["accessors"][-1].items() if v is not None}
        return len(self.json["accessors"]) - 1

    def texture(self, uri, wrap_s=REPEAT, wrap_t=REPEAT):
        self.json["images"].append({"uri": uri})
        self.json["samplers"].append({"wrapS": wrap_s, "wrapT": wrap_t})
        self.json["textures"].append({"source": len(self.json["images"]) - 1,
                                      "sampler": len(self.json["samplers"]) - 1})
        return len(self.json["textures"]) - 1

    def material(self, texture=None, mode="MASK", cutoff=0.5, factor=1, double_sided=True, **info):
        shading = {"baseColorFactor": [1, 1, 1, factor]}
        if texture is not None:
            shading["baseColorTexture"] = {"index": texture, **info}
        self.json["materials"].append({"name": f"m{len(self.json['materials'])}", "alphaMode": mode,
                                       "doubleSided": double_sided, "pbrMetallicRoughness": shading,
                                       **({"alphaCutoff": cutoff} if mode == "MASK" else {})})
        return len(self.json["materials"]) - 1

    def mesh(self, positions, indices, material, **attributes):
        """Attributes by name, each the arguments of accessor()."""
        named = {"POSITION": self.accessor(positions.astype(np.float32), "VEC3", 5126)}
        named |= {name: self.accessor(*given) for name, given in attributes.items()}
        self.json["meshes"].append({"primitives": [{
            "attributes": named, "material": material,
            "indices": self.accessor(indices.astype(np.uint32).reshape(-1), "SCALAR", 5125)}]})
        return len(self.json["meshes"]) - 1

    def node(self, mesh, **placement):
        self.json["nodes"].append({"mesh": mesh, **placement})

    def write(self):
        (self.folder / f"{self.name}.bin").write_bytes(self.data)
        document = dict(self.json, buffers=[{"uri": f"{self.name}.bin", "byteLength": len(self.data)}])
        path = self.folder / f"{self.name}.gltf"
        path.write_text(json.dumps({key: value for key, value in document.items() if value != []}))
        return path


def sheet(random, n, bend=0.3):
    """A bent sheet of n x n quads over [0, 1]^2, and its texture coordinates."""
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    wave = bend * np.sin(6 * u + random.random()) * np.cos(5 * v + random.random())
    positions = np.stack([u.ravel(), v.ravel(), wave.ravel()], axis=1)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    indices = np.concatenate([np.stack([a, a + 1, a + n + 2], axis=1), np.stack([a, a + n + 2, a + n + 1], axis=1)])
    return positions, indices, uv


def make_scene(folder, seed, sheets=24):
    """A stack of sheets, each with another material, some of them placed mirrored."""
    random = np.random.default_rng(seed)
    write_png(folder / "bytes.png", blobs(random, 300, np.uint8, 4))
    write_png(folder / "words.png", blobs(random, 97, np.uint16, 2))
    write_png(folder / "dot.png", np.full((1, 1, 4), 200, np.uint8))
    write_png(folder / "grey.png", np.full((5, 7, 3), 90, np.uint8))
    scene = Scene(folder, f"made{seed}")
    for i in range(sheets):
        wraps = random.choice([REPEAT, MIRROR, CLAMP], 2).tolist()
        picture = ["bytes.png", "words.png", "bytes.png", "words.png", "bytes.png", "dot.png", "grey.png", None][i % 8]
        texture = None if picture is None else scene.texture(picture, *wraps)
        info = {"texCoord": i % 2} if picture else {}
        if picture and i % 3 == 0:
            info["extensions"] = {"KHR_texture_transform": {
                "offset": random.normal(size=2).tolist(), "rotation": random.normal(),
                "scale": (4 * random.random(2) - 2).tolist(), "texCoord": 1}}
        material = scene.material(texture, "BLEND" if i % 7 == 6 else "MASK", 0.3 + 0.4 * random.random(),
                                  0.8 + 0.2 * random.random(), i % 4 != 1, **info)
        positions, indices, uv = sheet(random, [1, 3, 12, 40][i % 4])
        far = [1, 3, 20][i % 3]
        attributes = {"TEXCOORD_0": ((uv * far - far / 3).astype(np.float32), "VEC2", 5126),
                      "TEXCOORD_1": (np.round(uv * 65535).astype(np.uint16), "VEC2", 5123, True)}
        if i % 2 == 0:  # for those who ask for attributes
            normals = positions - positions.mean(axis=0) + [0, 0, 1]
            normals /= np.linalg.norm(normals, axis=1)[:, None]
            attributes["NORMAL"] = (normals.astype(np.float32), "VEC3", 5126)
        if i % 2 == 1 or picture is None:
            colors = np.round(np.clip(0.5 + random.random((len(uv), 4)), 0, 1) * 255).astype(np.uint8)
            attributes["COLOR_0"] = (colors, "VEC4", 5121, True)
        mesh = scene.mesh(positions, indices, material, **attributes)
        quarter = random.normal(size=4)
        for k in range(1 + i % 3):
            # Whole multiples of 2^-20, so that they stay what they are far from zero.
            scene.node(mesh, translation=(np.floor(random.random(3) * 2**21) / 2**20).tolist(),
                       rotation=(quarter / np.linalg.norm(quarter)).tolist(),
                       scale=[1 if k != 1 else -1, 1 + 0.3 * k, 1])
    return scene.write()
