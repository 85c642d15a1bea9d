//! The geometry, streamed: memory use is that of the meshes, however many instances there are.

use std::collections::HashMap;
use std::hash::Hash;
use std::io::{self, Write};

use glam::{Mat3, Vec2, Vec3};

use super::{ExportReport, file_stem};
use crate::scene::{Mesh, Scene};

/// Writes all instances at time 0 and counts what was written; every index in `scene` must be in range.
pub(super) fn write(
    scene: &Scene,
    mtl_file: &str,
    material_names: &[String],
    out: &mut impl Write,
) -> io::Result<ExportReport> {
    writeln!(out, "mtllib {mtl_file}")?;
    let meshes: Vec<SharedMesh> = scene.meshes.iter().map(SharedMesh::new).collect();
    let mut writer = ObjWriter { out, written: Written::default(), report: ExportReport::default() };
    for (index, instance) in scene.instances.iter().enumerate() {
        let mesh = &meshes[instance.mesh as usize];
        if mesh.source.triangles.is_empty() {
            continue;
        }
        writeln!(writer.out, "o {}-{index}", file_stem(&mesh.source.name))?;
        writer.instance(scene, mesh, instance.world_from_object_at(0.0), material_names)?;
    }
    Ok(writer.report)
}

/// A mesh whose equal positions, normals and texture coordinates are written once each.
struct SharedMesh<'a> {
    source: &'a Mesh,
    positions: Shared<Vec3>,
    normals: Shared<Vec3>,
    uvs: Shared<Vec2>,
    /// Triangles in the order of their materials, so that each material is named once.
    order: Vec<u32>,
}

/// Values without repetition, and which of them each vertex has.
struct Shared<T> {
    values: Vec<T>,
    of_vertex: Vec<u32>,
}

impl<T: Copy> Shared<T> {
    fn new<K: Eq + Hash>(all: &[T], key: impl Fn(T) -> K) -> Self {
        let mut index_of = HashMap::new();
        let mut values = Vec::new();
        let of_vertex = all
            .iter()
            .map(|&value| {
                *index_of.entry(key(value)).or_insert_with(|| {
                    values.push(value);
                    values.len() as u32 - 1
                })
            })
            .collect();
        Self { values, of_vertex }
    }
}

impl<'a> SharedMesh<'a> {
    fn new(source: &'a Mesh) -> Self {
        let bits = |v: Vec3| v.to_array().map(f32::to_bits);
        let mut order: Vec<u32> = (0..source.triangles.len() as u32).collect();
        order.sort_by_key(|&triangle| source.materials[triangle as usize]);
        Self {
            source,
            positions: Shared::new(&source.positions, bits),
            normals: Shared::new(&source.normals, bits),
            uvs: Shared::new(&source.uvs, |uv| uv.to_array().map(f32::to_bits)),
            order,
        }
    }
}

/// How many `v`, `vn` and `vt` lines the file has so far; OBJ counts from 1 through the whole file.
#[derive(Clone, Copy, Default)]
struct Written {
    positions: u64,
    normals: u64,
    uvs: u64,
}

struct ObjWriter<'a, W> {
    out: &'a mut W,
    written: Written,
    report: ExportReport,
}

impl<W: Write> ObjWriter<'_, W> {
    fn instance(
        &mut self,
        scene: &Scene,
        mesh: &SharedMesh,
        world_from_object: glam::Mat4,
        material_names: &[String],
    ) -> io::Result<()> {
        let base = self.written;
        let linear = Mat3::from_mat4(world_from_object);
        let world_from_normal = linear.inverse().transpose();
        let is_mirrored = linear.determinant() < 0.0;

        for &position in &mesh.positions.values {
            let p = world_from_object.transform_point3(position);
            writeln!(self.out, "v {} {} {}", p.x, p.y, p.z)?;
        }
        for &normal in &mesh.normals.values {
            // A zero normal keeps its place in the count; no face refers to it.
            let n = (world_from_normal * normal).normalize_or(Vec3::Y);
            writeln!(self.out, "vn {} {} {}", n.x, n.y, n.z)?;
        }
        for uv in &mesh.uvs.values {
            writeln!(self.out, "vt {} {}", uv.x, uv.y)?;
        }
        self.written.positions += mesh.positions.values.len() as u64;
        self.written.normals += mesh.normals.values.len() as u64;
        self.written.uvs += mesh.uvs.values.len() as u64;
        self.report.positions = self.written.positions;

        let mut current = None;
        for &triangle in &mesh.order {
            let material = mesh.source.materials[triangle as usize];
            if current != Some(material) {
                writeln!(self.out, "usemtl {}", material_names[material as usize])?;
                current = Some(material);
            }
            let mut corners = mesh.source.triangles[triangle as usize];
            if is_mirrored {
                corners.swap(1, 2);
            }
            self.face(mesh, base, corners, world_from_object)?;
            self.report.triangles += 1;
            self.report.emissive_triangles += u64::from(scene.materials[material as usize].emission != Vec3::ZERO);
        }
        Ok(())
    }

    fn face(
        &mut self,
        mesh: &SharedMesh,
        base: Written,
        corners: [u32; 3],
        world_from_object: glam::Mat4,
    ) -> io::Result<()> {
        let has_normals = !mesh.source.normals.is_empty();
        let lacks_normal = |&corner: &u32| mesh.source.normals[corner as usize] == Vec3::ZERO;
        // Such corners want the geometric normal, for which OBJ has no word unless it goes for the whole face.
        let geometric = has_normals && corners.iter().any(lacks_normal);
        if geometric {
            let [a, b, c] =
                corners.map(|corner| world_from_object.transform_point3(mesh.source.positions[corner as usize]));
            let n = (b - a).cross(c - a).normalize_or(Vec3::Y);
            writeln!(self.out, "vn {} {} {}", n.x, n.y, n.z)?;
            self.written.normals += 1;
        }

        write!(self.out, "f")?;
        for corner in corners {
            let vertex = corner as usize;
            let v = base.positions + u64::from(mesh.positions.of_vertex[vertex]) + 1;
            let vt = mesh.uvs.of_vertex.get(vertex).map(|&uv| base.uvs + u64::from(uv) + 1);
            let vn = mesh.normals.of_vertex.get(vertex).map(|&normal| {
                if lacks_normal(&corner) { self.written.normals } else { base.normals + u64::from(normal) + 1 }
            });
            match (vt, vn) {
                (Some(vt), Some(vn)) => write!(self.out, " {v}/{vt}/{vn}")?,
                (Some(vt), None) => write!(self.out, " {v}/{vt}")?,
                (None, Some(vn)) => write!(self.out, " {v}//{vn}")?,
                (None, None) => write!(self.out, " {v}")?,
            }
        }
        writeln!(self.out)
    }
}
