"""What `weir export --lambert --flat` writes: an OBJ with its MTL, a camera, and lights that are no triangles."""

import argparse
import json
import os

import numpy as np


def read_materials(path):
    """Kd, Ke and map_Kd of each material of an MTL file."""
    materials, current = {}, None
    with open(path, encoding="utf-8") as lines:
        for words in map(str.split, lines):
            if not words:
                continue
            if words[0] == "newmtl":
                current = materials.setdefault(words[1], {"Kd": [0.8] * 3, "Ke": [0.0] * 3, "map_Kd": None})
            elif words[0] in ("Kd", "Ke") and current is not None:
                current[words[0]] = [float(v) for v in words[1:4]]
            elif words[0] == "map_Kd" and current is not None:
                current["map_Kd"] = os.path.join(os.path.dirname(path), words[-1])
    return materials


def read_obj(path):
    """Positions, texture coordinates, and for each material the corners of its triangles as pairs of indices."""
    positions, uvs, faces, material, library = [], [], {}, None, None
    with open(path, encoding="utf-8") as lines:
        for words in map(str.split, lines):
            if not words:
                continue
            if words[0] == "v":
                positions.append([float(v) for v in words[1:4]])
            elif words[0] == "vt":
                uvs.append([float(v) for v in words[1:3]])
            elif words[0] == "usemtl":
                material = faces.setdefault(words[1], [])
            elif words[0] == "mtllib":
                library = os.path.join(os.path.dirname(path), words[1])
            elif words[0] == "f":
                corners = [corner.split("/") for corner in words[1:]]
                index = [(int(c[0]), int(c[1]) if len(c) > 1 and c[1] else 0) for c in corners]
                index = [(v - 1 if v > 0 else len(positions) + v, t - 1 if t > 0 else -1) for v, t in index]
                for i in range(1, len(index) - 1):
                    material.append((index[0], index[i], index[i + 1]))
    return np.array(positions, np.float32), np.array(uvs, np.float32), faces, read_materials(library)


def read_camera(path):
    """origin, target, up, and vfov_deg."""
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def read_lights(obj):
    """The lights that are no triangles: those of `NAME.lights.json` beside `NAME.obj`, if there is one."""
    path = os.path.splitext(obj)[0] + ".lights.json"
    if not os.path.exists(path):
        return []
    with open(path, encoding="utf-8") as file:
        return json.load(file)["lights"]


def parser(description):
    """Of the command line of a script that draws an export."""
    parsed = argparse.ArgumentParser(description=description)
    parsed.add_argument("obj")
    parsed.add_argument("camera")
    parsed.add_argument("output")
    parsed.add_argument("--spp", type=int, default=64, help="samples a pixel")
    parsed.add_argument("--size", type=size, default=(320, 180), help="WxH in pixels")
    return parsed


def size(text):
    """WxH as a pair."""
    width, height = text.split("x")
    return int(width), int(height)
