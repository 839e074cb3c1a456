"""PLY, OBJ and STL files that break a rule each: name, suffix, bytes, what the sentence says."""

import struct


def ply(vertices=3, body=b"", corners=(0, 1, 2), encoding="binary_little_endian", promised=None):
    """One face over `vertices` vertices, all but three of them at the origin."""
    head = (f"ply\nformat {encoding} 1.0\nelement vertex {promised or vertices}\nproperty float x\nproperty float y\n"
            "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n").encode()
    points = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    face = struct.pack(f"<B{len(corners)}i", len(corners), *corners)
    return head + (body or points + bytes(12 * (vertices - 3)) + face)


def stl(facets=1, promised=None, head=b"solid that is none"):
    facet = struct.pack("<12f", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0) + b"\0\0"
    return head.ljust(80) + struct.pack("<I", facets if promised is None else promised) + facet * facets


WORDS = (b"solid one\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
         b"endsolid one\n")
POINTS = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
NAN = struct.pack("<f", float("nan"))

CASES = [
    ("PLY cut in its header", "ply", ply()[:60], "header"),
    ("PLY cut in its vertices", "ply", ply()[:-20], "cut short"),
    ("PLY cut in its face", "ply", ply()[:-2], "face 0"),
    ("PLY of 2^40 vertices", "ply", ply(promised=1 << 40), "1099511627776"),
    ("PLY index past its vertices", "ply", ply(corners=(0, 1, 3)), "vertex 3"),
    ("PLY negative index", "ply", ply(corners=(0, 1, -1)), "vertex -1"),
    ("PLY of an unknown format", "ply", ply(encoding="gzip"), "format"),
    ("PLY without faces", "ply", ply().replace(b"element face 1", b"element face 0"), "no faces"),
    ("PLY in words that are none", "ply", ply(encoding="ascii", body=b"0 0 0 1 zero 0 0 1 0 3 0 1 2\n"), "'zero'"),
    ("PLY of NaN", "ply", ply(body=NAN * 9 + struct.pack("<B3i", 3, 0, 1, 2)), ""),
    ("text as a PLY", "ply", b"not a mesh\n" * 50, "PLY"),
    ("OBJ index past its vertices", "obj", POINTS + b"f 1 2 4\n", "line 4"),
    ("OBJ negative index past its vertices", "obj", POINTS + b"f -1 -2 -4\n", "line 4"),
    ("OBJ index of zero", "obj", POINTS + b"f 0 1 2\n", "vertex 0"),
    ("OBJ coordinate that is no number", "obj", POINTS + b"v 1 two 3\nf 1 2 3\n", "'two'"),
    ("OBJ without faces", "obj", POINTS, "no faces"),
    ("OBJ of lines only", "obj", POINTS + b"l 1 2 3\n", "no faces"),
    ("OBJ of one degenerate face", "obj", POINTS + b"f 1 2 2\n", ""),
    ("noise as an OBJ", "obj", bytes(range(256)) * 20, "no faces"),
    ("OBJ face of 20 000 corners", "obj", POINTS + b"f" + b" 1 2" * 10_000, "corners"),
    ("STL cut short", "stl", stl()[:-10], "cut short"),
    ("STL longer than its facets", "stl", stl() + b"x", "51 bytes"),
    ("STL of 2^32 - 1 facets", "stl", stl(promised=0xFFFFFFFF), "4294967295"),
    ("STL without facets", "stl", stl(facets=0), ""),
    ("empty STL", "stl", b"", "0 bytes"),
    ("STL in words, cut short", "stl", WORDS[:WORDS.index(b"vertex 1")], "cut short"),
    ("STL in words, cut between facets", "stl", WORDS[:WORDS.index(b"endsolid")], "cut short"),
    ("STL in words that are others", "stl", WORDS.replace(b"outer", b"inner"), "'outer'"),
    ("noise of no known name", "dat", bytes(range(256)), "no scene"),
]
