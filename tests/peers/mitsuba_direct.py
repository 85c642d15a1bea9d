"""Direct light of a scene that `weir export --lambert --flat` wrote, by Mitsuba 3: an EXR, and the time on stdout.

Every surface is diffuse with Kd or map_Kd and has its geometric normal; emission leaves the front face, as in weir. A
first picture with one sample, which is not counted, compiles the kernels.
"""

import time

import numpy as np

import exported


def scene_of(mi, arguments):
    positions, uvs, faces, materials = exported.read_obj(arguments.obj)
    camera = exported.read_camera(arguments.camera)
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
    parser = exported.parser(__doc__)
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
