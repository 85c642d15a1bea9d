"""Direct light of a scene that `weir export --lambert --flat` wrote, by Mitsuba 3: an EXR, and the time on stdout.

Every surface is diffuse with Kd or map_Kd and has its geometric normal; emission leaves the front face, as in weir. A
first picture with one sample, which is not counted, compiles the kernels.

Points, directional lights, spheres and rectangles are Mitsuba's own; spheres and rectangles block rays there, and don't
in weir. Spots are the same only where both cones are equal: between them Mitsuba's fade linearly with the angle.
"""

import time

import numpy as np

import exported


def emitter_of(mi, light):
    """A light of `NAME.lights.json` as Mitsuba's."""
    strength = {"point": "intensity", "spot": "intensity", "directional": "irradiance"}.get(light["type"], "radiance")
    color = [c * light[strength] for c in light.get("color", [1.0, 1.0, 1.0])]
    emission = {strength: {"type": "rgb", "value": color}}
    area = {"type": "area", **emission}
    match light["type"]:
        case "point":
            return {"type": "point", "position": light["position"], **emission}
        case "directional":
            return {"type": "directional", "direction": light["direction"], **emission}
        case "spot":
            origin, direction = np.array(light["position"]), np.array(light["direction"])
            up = np.eye(3)[np.argmin(np.abs(direction))]
            return {
                "type": "spot", "cutoff_angle": light["outer_cone_deg"],
                # Equal cones would divide by zero.
                "beam_width": min(light.get("inner_cone_deg", 0.0), 0.9999 * light["outer_cone_deg"]),
                "to_world": mi.ScalarTransform4f().look_at(list(origin), list(origin + direction), list(up)),
                **emission,
            }
        case "sphere":
            return {"type": "sphere", "center": light["position"], "radius": light["radius"], "emitter": area}
        case "rectangle":
            u, v, center = (np.array(light[field]) for field in ("u", "v", "position"))
            front = np.cross(u, v)
            front /= np.linalg.norm(front)
            matrix = np.eye(4)
            matrix[:3] = np.column_stack([u, v, front, center])
            return {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix), "emitter": area}
        case kind:
            raise ValueError(f"a light of type {kind}")


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
    for number, light in enumerate(exported.read_lights(arguments.obj)):
        scene[f"light{number}"] = emitter_of(mi, light)
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
