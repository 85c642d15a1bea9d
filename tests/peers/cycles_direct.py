"""Direct light of a scene that `weir export --lambert --flat` wrote, by Cycles: an EXR, and the time on stdout.

Every surface is diffuse with Kd or map_Kd and has its geometric normal; emission leaves the front face, as in weir: Cycles
would light both, and is told not to. Its light tree is on; its clamps, thresholds and filters are off. The time is
that of all samples but one: what a picture of one sample takes as well, to load the scene and build its structures, is
taken off.
"""

import os
import sys
import time

import bpy
import numpy as np
from mathutils import Matrix, Vector

import exported


def material_of(name, values):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Roughness"].default_value = 0.0
    diffuse.inputs["Color"].default_value = (*values["Kd"], 1.0)
    if values["map_Kd"]:
        texture = nodes.new("ShaderNodeTexImage")
        texture.image = bpy.data.images.load(os.path.abspath(values["map_Kd"]))
        texture.image.colorspace_settings.name = "sRGB"
        links.new(texture.outputs["Color"], diffuse.inputs["Color"])
    surface = diffuse.outputs["BSDF"]
    if any(values["Ke"]):
        strength = max(values["Ke"])
        emission = nodes.new("ShaderNodeEmission")
        emission.inputs["Color"].default_value = (*[v / strength for v in values["Ke"]], 1.0)
        front = nodes.new("ShaderNodeMath")
        front.operation = "MULTIPLY_ADD"
        front.inputs[1].default_value = -strength
        front.inputs[2].default_value = strength
        links.new(nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], front.inputs[0])
        links.new(front.outputs["Value"], emission.inputs["Strength"])
        both = nodes.new("ShaderNodeAddShader")
        links.new(surface, both.inputs[0])
        links.new(emission.outputs["Emission"], both.inputs[1])
        surface = both.outputs["Shader"]
        material.cycles.emission_sampling = "FRONT"
    links.new(surface, output.inputs["Surface"])
    return material


def add_mesh(name, corners, positions, uvs, material):
    mesh = bpy.data.meshes.new(name)
    count = len(corners)
    mesh.vertices.add(count)
    mesh.vertices.foreach_set("co", positions[corners[:, 0]].ravel())
    mesh.loops.add(count)
    mesh.loops.foreach_set("vertex_index", np.arange(count, dtype=np.int32))
    mesh.polygons.add(count // 3)
    mesh.polygons.foreach_set("loop_start", np.arange(0, count, 3, dtype=np.int32))
    if len(uvs):
        mesh.uv_layers.new().data.foreach_set("uv", uvs[np.maximum(corners[:, 1], 0)].ravel())
    mesh.materials.append(material)
    mesh.update(calc_edges=True)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def add_camera(values):
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "VERTICAL"
    camera.angle = np.radians(values["vfov_deg"])
    camera.clip_start, camera.clip_end = 1e-4, 1e7
    placed = bpy.data.objects.new("camera", camera)
    origin = Vector(values["origin"])
    backward = (origin - Vector(values["target"])).normalized()
    right = Vector(values["up"]).cross(backward).normalized()
    rotation = Matrix((right, backward.cross(right), backward)).transposed()
    placed.matrix_world = Matrix.Translation(origin) @ rotation.to_4x4()
    bpy.context.scene.collection.objects.link(placed)
    bpy.context.scene.camera = placed


def set_up(size):
    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = 100
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGB"
    render.image_settings.color_depth = "32"
    cycles.device = "CPU"
    cycles.use_light_tree = True
    cycles.max_bounces = 0
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.light_sampling_threshold = 0.0
    cycles.pixel_filter_type = "BOX"
    # Of width one pixel: the narrowest.
    cycles.filter_width = 1.0
    world = bpy.data.worlds.new("black")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    scene.world = world
    return scene


def seconds_of(scene, samples):
    scene.cycles.samples, scene.cycles.seed = samples, samples
    start = time.perf_counter()
    bpy.ops.render.render(write_still=False)
    return time.perf_counter() - start


def main():
    arguments = exported.parser(__doc__).parse_args()
    if exported.read_lights(arguments.obj):
        raise SystemExit("lights that are no triangles are not drawn by Cycles here; mitsuba_direct.py draws them")
    if arguments.spp < 2:
        raise SystemExit("--spp takes 2 or more: the time is that of all samples but one")

    bpy.ops.wm.read_factory_settings(use_empty=True)
    # Only the time goes to the standard output; Blender's own messages go where errors go.
    stdout = os.dup(1)
    os.dup2(2, 1)
    scene = set_up(arguments.size)
    positions, uvs, faces, materials = exported.read_obj(arguments.obj)
    for name, triangles in faces.items():
        if triangles:
            corners = np.array(triangles, np.int64).reshape(-1, 2)
            add_mesh(name, corners, positions, uvs, material_of(name, materials[name]))
    add_camera(exported.read_camera(arguments.camera))
    scene.render.filepath = os.path.abspath(arguments.output)
    alone = seconds_of(scene, 1)
    elapsed = (seconds_of(scene, arguments.spp) - alone) * arguments.spp / (arguments.spp - 1)
    bpy.data.images["Render Result"].save_render(scene.render.filepath)
    sys.stdout.flush()
    os.dup2(stdout, 1)
    print(f"{elapsed:.3f}")


if __name__ == "__main__":
    main()
