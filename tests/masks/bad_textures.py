"""Scenes whose masks cannot be read, or only just: what is said of each, and with which code."""

import json

import numpy as np

from made_scene import Scene, sheet, write_png

INPUT, MEMORY = 42, 33


class Leaf:
    """A sheet with one masked material, to be spoilt."""

    def __init__(self, folder, name, picture="leaf.png", size=8, uv=None, **material):
        self.folder, self.path = folder, folder / f"{name}.gltf"
        random = np.random.default_rng(1)
        if picture:
            pixels = np.full((size, size, 4), 255, np.uint8)
            pixels[::2, ::2, 3] = 0
            write_png(folder / picture, pixels)
        self.scene = Scene(folder, name)
        number = self.scene.material(self.scene.texture(picture) if picture else None, **material)
        positions, indices, coordinates = sheet(random, 4)
        coordinates = coordinates if uv is None else uv(coordinates)
        mesh = self.scene.mesh(positions, indices, number,
                               TEXCOORD_0=(coordinates.astype(np.float32), "VEC2", 5126))
        self.scene.node(mesh)

    def write(self, change=None):
        path = self.scene.write()
        if change:
            document = json.loads(path.read_text())
            change(document)
            path.write_text(json.dumps(document))
        return path


def spoilt(values):
    def change(uv):
        uv = uv.copy()
        uv[3] = values
        return uv
    return change


def cases(folder):
    """(name, scene, options, rc, what the sentence or the report must say)"""
    def leaf(name, **given):
        return Leaf(folder, name, **given)

    def without(*path):
        def change(document):
            for step in path[:-1]:
                document = document[step]
            del document[path[-1]]
        return change

    def put(value, *path):
        def change(document):
            for step in path[:-1]:
                document = document[step]
            document[path[-1]] = value
        return change

    missing = leaf("missing").write(put("gone.png", "images", 0, "uri"))
    yield "a picture that is not there", missing, [], INPUT, "gone.png"
    yield "the same, with alpha ignored", missing, ["--ignore-alpha"], 0, ""
    broken = leaf("broken", picture="broken.png")
    (folder / "broken.png").write_bytes((folder / "broken.png").read_bytes()[:60])
    yield "a picture that was cut", broken.write(), [], INPUT, "broken.png"
    (folder / "words.png").write_text("no picture at all\n")
    yield "no picture", leaf("words").write(put("words.png", "images", 0, "uri")), [], INPUT, "words.png"
    yield ("a picture elsewhere", leaf("far").write(put("http://example.org/a.png", "images", 0, "uri")), [], INPUT,
           "images[0]")
    yield ("no texture coordinates",
           leaf("flat").write(without("meshes", 0, "primitives", 0, "attributes", "TEXCOORD_0")), [], INPUT,
           "TEXCOORD_0")
    texture = ("materials", 0, "pbrMetallicRoughness", "baseColorTexture")
    yield "a set that is not there", leaf("set").write(put(5, *texture, "texCoord")), [], INPUT, "TEXCOORD_5"
    yield "a texture that is not there", leaf("index").write(put(7, *texture, "index")), [], INPUT, "texture"
    yield "an image that is not there", leaf("source").write(put(7, "textures", 0, "source")), [], INPUT, "image"
    yield "a cutoff below 0", leaf("negative").write(put(-1, "materials", 0, "alphaCutoff")), [], INPUT, "alphaCutoff"
    yield ("a cutoff that is a word", leaf("word").write(put("half", "materials", 0, "alphaCutoff")), [], INPUT,
           "alphaCutoff")
    yield "a cutoff above 1", leaf("above", cutoff=1.5).write(), [], INPUT, "dropped_cut_out"
    yield "a mode that is none", leaf("mode").write(put("GLASS", "materials", 0, "alphaMode")), [], INPUT, "alphaMode"
    yield "a mask without a texture", leaf("bare", picture=None).write(), [], 0, ""
    yield "the same below its cutoff", leaf("low", picture=None, factor=0.2).write(), [], INPUT, "dropped_cut_out"
    for name, values in (("nan", (np.nan, 0)), ("inf", (0, np.inf)), ("huge", (1e30, 0))):
        yield (f"texture coordinates: {name}", leaf(f"uv-{name}", uv=spoilt(values)).write(), [], 0,
               "opaque_without_texcoords")
    yield "texture coordinates of a million", leaf("million", uv=spoilt((1e6, -1e6))).write(), [], 0, "masked_triangles"
    yield "one texel", leaf("one", picture="one.png", size=1).write(), [], INPUT, "dropped_cut_out"
    yield "a wrap that is none", leaf("wrap").write(put(1, "samplers", 0, "wrapS")), [], INPUT, "wrapS"


def large(folder, edge):
    return Leaf(folder, f"edge{edge}", picture=f"edge{edge}.png", size=edge).write()
