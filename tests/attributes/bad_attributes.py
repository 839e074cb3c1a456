"""What attributes may be asked for and what a file may say of them that does not fit: a sentence and a code each."""

import json
import subprocess

import gltf_encodings


def fails(trial, what, code, sentence, *words):
    """One sentence on stderr that says this, the exit code, and no output."""
    out = trial.folder / "bad.mill"
    done = subprocess.run([str(word) for word in (trial.options.raymill, *words)], capture_output=True, text=True,
                          check=False)
    trial.check(f"{what}: code {code}, '{sentence}' ({done.returncode}: {done.stderr.strip()})",
                done.returncode == code and sentence in done.stderr and done.stderr.count("\n") == 1 and
                not out.exists())


def changed(trial, scene, change):
    """The scene with what `change` does to its document."""
    document = json.loads(scene.read_text())
    change(document)
    path = scene.with_name("changed.gltf")
    path.write_text(json.dumps(document))
    return path


def first(document, name):
    """The first accessor of this name."""
    for mesh in document["meshes"]:
        if name in mesh["primitives"][0]["attributes"]:
            return document["accessors"][mesh["primitives"][0]["attributes"][name]]
    raise KeyError(name)


def try_bad_files(trial, scene):
    out = ["-o", trial.folder / "bad.mill"]

    def build(what, code, sentence, change, names="normal,uv0,color0"):
        fails(trial, what, code, sentence, "build", changed(trial, scene, change), *out, "--attributes", names)

    def renamed(document):
        for mesh in document["meshes"]:
            mesh["primitives"][0]["attributes"] = {"POSITION": mesh["primitives"][0]["attributes"]["POSITION"]}

    build("an attribute that no store keeps", 2, "none of those that a store keeps", lambda _: None, "normal,tangent")
    build("an empty name", 2, "none of those that a store keeps", lambda _: None, "normal,")
    build("too few", 42, "elements of NORMAL for", lambda d: first(d, "NORMAL").update(count=2))
    build("of another type", 42, "of no type that TEXCOORD_0 may have",
          lambda d: first(d, "TEXCOORD_0").update(type="SCALAR"))
    build("integers that are not normalised", 42, "integers of a kind",
          lambda d: first(d, "COLOR_0").update(componentType=5123, normalized=False))
    build("no accessor of the file", 42, "names no accessor",
          lambda d: d["meshes"][0]["primitives"][0]["attributes"].update(NORMAL=99999))
    build("past its buffer", 42, "", lambda d: first(d, "NORMAL").update(byteOffset=1 << 30))
    build("nothing of what is asked for", 42, "no triangle of the scene has any", renamed)
    store, plain = trial.folder / "made.mill", trial.folder / "plain.mill"
    some, hits = trial.folder / "few.npy", trial.folder / "bad.npy"
    trial.build(scene, "made.mill", "--attributes", "normal,uv0")
    trial.build(scene, "plain.mill")

    def trace(what, code, sentence, path, *words):
        fails(trial, what, code, sentence, "trace", path, some, "-o", hits, *words)

    trace("a store that keeps none", 2, "build it with --attributes normal", plain, "--fields", "t,shading_normal")
    trace("a store that keeps others", 2, "--attributes normal,uv0,color0", store, "--fields", "t,color0")
    trace("all hits", 2, "only the query closest", store, "--query", "all", "--fields", "t,uv0")
    trace("any hit", 2, "leave --fields out", store, "--query", "any", "--fields", "uv0")
    damaged = bytearray(store.read_bytes())
    information = json.loads(subprocess.run([str(trial.options.raymill), "info", str(store), "--json"],
                                            capture_output=True, text=True, check=True).stdout)
    last = information["pages"] - 1
    page = json.loads(subprocess.run([str(trial.options.raymill), "inspect", str(store), "--page", str(last)],
                                     capture_output=True, text=True, check=True).stdout)
    trial.check("the last page is one of attributes", page["attributes"] == "normal,uv0" and "entries" in page)
    damaged[page["offset"] + page["encoded_bytes"] // 2] ^= 4
    broken = trial.folder / "broken.mill"
    broken.write_bytes(damaged)
    fails(trial, "a damaged page of attributes", 42, f"page {last}", "verify", broken)


def try_bad_encodings(trial, scene):
    """Sparse accessors and compressed views of attributes that say what cannot be."""
    def build(what, sentence, path, change):
        fails(trial, what, 42, sentence, "build", changed(trial, path, change), "-o", trial.folder / "bad.mill",
              "--attributes", "normal")

    def stream(document):
        view = document["bufferViews"][first(document, "NORMAL")["bufferView"]]
        return view["extensions"]["EXT_meshopt_compression"]

    def sparse(document):
        return first(document, "NORMAL")["sparse"]

    path = gltf_encodings.sparse(scene)
    build("more sparse rows than rows", "sparse", path, lambda d: sparse(d).update(count=1 << 20))
    build("sparse indices of floats", "sparse", path, lambda d: sparse(d)["indices"].update(componentType=5126))
    build("sparse indices that do not rise", "sparse", path,
          lambda d: sparse(d)["indices"].update(bufferView=sparse(d)["values"]["bufferView"]))
    build("sparse values past their view", "", path, lambda d: sparse(d)["values"].update(byteOffset=1 << 20))
    build("sparse values of no view", "bufferViews", path, lambda d: sparse(d)["values"].update(bufferView=9999))
    path, _ = gltf_encodings.meshopt(scene)
    build("a stream cut short", "meshopt stream does not decode", path,
          lambda d: stream(d).update(byteLength=stream(d)["byteLength"] // 2))
    build("a stream that is none", "meshopt stream does not decode", path,
          lambda d: stream(d).update(byteOffset=stream(d)["byteOffset"] + 8))
    build("a stream of more rows than it has", "", path, lambda d: stream(d).update(count=1 << 16))
    build("a filter that is none", "filter", path, lambda d: stream(d).update(filter="CUBIC"))
