"""Direct light of a scene that `weir export --lambert --flat` wrote, by Mitsuba 3: an EXR, and the time on stdout.

Every surface is diffuse with Kd or map_Kd and has its geometric normal; emission leaves the front face, as in weir. A
first picture with one sample, which is not counted, compiles the kernels.
"""

import argparse
import json
import os
import time

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


def scene_of(mi, arguments):
    positions, uvs, faces, materials = read_obj(arguments.obj)
    with open(arguments.camera, encoding="utf-8") as file:
        camera = json.load(file)
    width, height = arguments.size
    scene = {
        "type": "scene",
        "integrator": {"type": "direct"},
        "sensor": {
            "type": "perspective",
            "fov": camera["vfov_deg"],
            "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(camera["origin"], camera["target"], camera["up"]),
            "film": {
                "type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb",
                "component_format": "float32", "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        },
    }
    for number, (name, triangles) in enumerate(faces.items()):
        if not triangles:
            continue
        corners = np.array(triangles, np.int64).reshape(-1, 2)
        material = materials[name]
        reflectance = {"type": "rgb", "value": material["Kd"]}
        if material["map_Kd"]:
            reflectance = {"type": "bitmap", "filename": material["map_Kd"]}
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(
            {"type": "twosided", "nested": {"type": "diffuse", "reflectance": reflectance}}
        )
        properties["face_normals"] = True
        if any(material["Ke"]):
            properties["emitter"] = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": material["Ke"]}})
        mesh = mi.Mesh(
            f"m{number}", vertex_count=len(corners), face_count=len(triangles), has_vertex_texcoords=True, props=properties
        )
        values = mi.traverse(mesh)
        values["vertex_positions"] = positions[corners[:, 0]].ravel()
        values["faces"] = np.arange(len(corners), dtype=np.uint32)
        # Where there is no texture there need be no coordinates.
        uv = uvs[np.maximum(corners[:, 1], 0)] if len(uvs) else np.zeros((len(corners), 2), np.float32)
        values["vertex_texcoords"] = uv.ravel()
        values.update()
        scene[f"mesh{number}"] = mesh
    return mi.load_dict(scene)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("obj")
    parser.add_argument("camera")
    parser.add_argument("output")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--size", type=lambda text: tuple(int(v) for v in text.split("x")), default=(320, 180))
    parser.add_argument("--variant", default="llvm_ad_rgb")
    arguments = parser.parse_args()
    import mitsuba as mi

    mi.set_variant(arguments.variant)
    scene = scene_of(mi, arguments)
    np.array(mi.render(scene, spp=1, seed=1))
    start = time.perf_counter()
    image = mi.render(scene, spp=arguments.spp, seed=2)
    # Evaluation is lazy: reading waits for it.
    np.array(image)
    elapsed = time.perf_counter() - start
    mi.util.write_bitmap(arguments.output, image, write_async=False)
    print(f"{elapsed:.3f}")


if __name__ == "__main__":
    main()
