//! Geometry from Wavefront OBJ: all objects and groups of a file become one mesh.
//!
//! Polygons are cut into fans, which is right for convex ones. Materials stay names here: [`super::load`] finds them.

use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};

use glam::{Vec2, Vec3};

use super::Mesh;
use super::error::{Place, SceneError, Warnings};
use super::normalize::Normalizer;

/// What an OBJ file holds.
pub struct ObjFile {
    /// Its triangles; their materials are indices into `material_names`, or one past its end for none.
    pub mesh: Mesh,
    /// The names that `usemtl` gave, in order of first use.
    pub material_names: Vec<String>,
    /// The line where each of them comes first.
    pub material_lines: Vec<u64>,
    /// The file names of each `mtllib`, as written, and the line it is on.
    pub material_libraries: Vec<(String, u64)>,
}

/// Reads OBJ text of `file` (the name for messages), at most `max_bytes` of it.
///
/// Triangles without an area that f32 can express are left out, as are those with a vertex that is not finite; their vertices stay, for [`drop_unused_vertices`] to remove. Normals come out with length 1, or 0 where missing.
///
/// # Errors
/// When reading fails, a statement is malformed, or the file holds no triangle.
pub fn read(reader: impl Read, file: &str, max_bytes: u64, warnings: &mut Warnings) -> Result<ObjFile, SceneError> {
    let mut normalizer = Normalizer::new(reader, file, max_bytes);
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ..Default::default() };
    // The statements that reach tobj are checked, so it has no reason to panic; if it does, the viewer goes on.
    let models = catch_unwind(AssertUnwindSafe(|| {
        tobj::load_obj_buf(&mut normalizer, &options, |_| Err(tobj::LoadError::OpenFileFailed))
    }));
    let models = match models {
        Ok(Ok((models, _))) => models,
        Ok(Err(reason)) => return Err(normalizer.explain(&reason.to_string())),
        Err(_) => return Err(normalizer.explain("the parser failed")),
    };
    let mut statements = normalizer.statements;
    statements.finish();
    warnings.append(statements.warnings);

    let mut mesh = Mesh { name: file.to_owned(), ..Mesh::default() };
    let no_material = statements.material_names.len() as u32;
    let (mut without_area, mut not_finite) = (0, 0);
    for model in models {
        let material = model.name.parse().unwrap_or(no_material);
        let tobj::Mesh { positions, normals, texcoords, indices, .. } = model.mesh;
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(positions.chunks_exact(3).map(Vec3::from_slice));
        if statements.has_normals {
            mesh.normals.extend(normals.chunks_exact(3).map(|normal| unit_or_zero(Vec3::from_slice(normal))));
        }
        if statements.has_uvs {
            mesh.uvs.extend(texcoords.chunks_exact(2).map(Vec2::from_slice));
        }
        for corners in indices.chunks_exact(3) {
            let triangle = [first + corners[0], first + corners[1], first + corners[2]];
            let [a, b, c] = triangle.map(|index| mesh.positions[index as usize]);
            // As a shader computes it: it cannot have a normal where this is 0.
            let squared_area = (b - a).cross(c - a).length_squared();
            if !(a.is_finite() && b.is_finite() && c.is_finite()) {
                not_finite += 1;
            } else if squared_area.is_normal() {
                mesh.triangles.push(triangle);
                mesh.materials.push(material);
            } else {
                without_area += 1;
            }
        }
    }
    warnings.push_count(Place::new(file, 0), not_finite, |n| {
        format!("triangles dropped because a vertex is not finite: {n}")
    });
    warnings
        .push_count(Place::new(file, 0), without_area, |n| format!("triangles dropped because they have no area: {n}"));
    if mesh.triangles.is_empty() {
        let what = match without_area + not_finite {
            0 => "the file holds no triangles".to_owned(),
            count => {
                format!("all {count} triangles lack an area, or have a vertex that is not finite")
            }
        };
        let help = "check that this is a Wavefront OBJ file with faces (`f`)";
        return Err(SceneError::bad_data(Place::new(file, 0), what, help));
    }
    let super::statements::Statements { material_names, material_lines, material_libraries, .. } = statements;
    Ok(ObjFile { mesh, material_names, material_lines, material_libraries })
}

/// Length 1, or zero where there is no direction.
fn unit_or_zero(normal: Vec3) -> Vec3 {
    // In f64, because the square of a short or long f32 vector is 0 or infinite.
    normal.as_dvec3().try_normalize().map_or(Vec3::ZERO, |unit| unit.as_vec3())
}

/// Keeps the triangles whose material index passes the test.
pub fn retain_materials(mesh: &mut Mesh, keep: impl Fn(u32) -> bool) {
    let mut kept = mesh.materials.iter().map(|&material| keep(material));
    mesh.triangles.retain(|_| kept.next().unwrap_or(false));
    mesh.materials.retain(|&material| keep(material));
}

/// Removes the vertices that no triangle uses.
pub fn drop_unused_vertices(mesh: &mut Mesh) {
    const UNUSED: u32 = u32::MAX;
    let mut new_index = vec![UNUSED; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&index| new_index[index as usize] = 0);
    if !new_index.contains(&UNUSED) {
        return;
    }
    let used = new_index.iter_mut().filter(|index| **index != UNUSED);
    used.zip(0..).for_each(|(index, new)| *index = new);
    fn compact<T>(list: &mut Vec<T>, new_index: &[u32]) {
        let mut used = new_index.iter().map(|&index| index != UNUSED);
        list.retain(|_| used.next().unwrap_or(false));
    }
    compact(&mut mesh.positions, &new_index);
    compact(&mut mesh.normals, &new_index);
    compact(&mut mesh.uvs, &new_index);
    mesh.triangles.iter_mut().flatten().for_each(|index| *index = new_index[*index as usize]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> (ObjFile, Vec<String>) {
        let mut warnings = Warnings::default();
        let obj = read(text.as_bytes(), "t.obj", u64::MAX, &mut warnings).expect("valid");
        (obj, warnings.into_vec().iter().map(ToString::to_string).collect())
    }

    #[test]
    fn corners_without_a_normal_have_the_zero_vector() {
        let (obj, warnings) = parse("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nf 1//1 2 3//-1");
        assert_eq!(obj.mesh.normals, [Vec3::Z, Vec3::ZERO, Vec3::Z]);
        assert!(obj.mesh.uvs.is_empty());
        assert_eq!(warnings, Vec::<String>::new());
    }

    #[test]
    fn a_file_without_normals_has_none() {
        let (obj, _) = parse("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0.5 0.25\nf 1/1 2/1 3");
        assert!(obj.mesh.normals.is_empty());
        assert_eq!(obj.mesh.uvs, [Vec2::new(0.5, 0.25), Vec2::new(0.5, 0.25), Vec2::ZERO]);
    }

    #[test]
    fn polygons_become_fans() {
        let (obj, _) = parse("v 0 0 0\nv 2 0 0\nv 3 1 0\nv 2 2 0\nv 0 2 0\nf -5 -4 -3 -2 -1");
        assert_eq!(obj.mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    }

    #[test]
    fn triangles_remember_the_material_in_force_also_across_objects() {
        let (obj, _) = parse(
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl b\no x\nf 1 2 3\nusemtl\ta\nf 1 2 3\ng y\nusemtl b\nf 1 2 3",
        );
        assert_eq!(obj.material_names, ["b", "a"]);
        assert_eq!(obj.mesh.materials, [2, 0, 1, 0]);
    }

    #[test]
    fn unused_vertices_are_dropped_and_the_others_renumbered() {
        let (mut obj, _) = parse("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 2\nf 2 3 4");
        assert_eq!(obj.mesh.positions.len(), 4);
        drop_unused_vertices(&mut obj.mesh);
        assert_eq!(obj.mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
        assert_eq!(obj.mesh.triangles, [[0, 1, 2]]);
    }

    #[test]
    fn vertices_beyond_reach_take_their_triangles_with_them() {
        let (obj, warnings) = parse("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1e39 0 0\nv nan 0 0\nf 1 2 3\nf 1 2 4\nf 5 2 3");
        assert_eq!(obj.mesh.triangles.len(), 1);
        assert!(warnings[0].starts_with("t.obj:4: vertices with coordinates that are not finite"), "{warnings:?}");
        assert_eq!(warnings[1], "t.obj: triangles dropped because a vertex is not finite: 2");
    }

    #[test]
    fn homogeneous_coordinates_are_divided_and_colours_stripped() {
        let (obj, warnings) = parse("v 0 0 0 2\nv 2 0 0 2\nv 0 1 0 0.5 0.5 0.5\nf 1 2 3");
        assert_eq!(obj.mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
        assert_eq!(warnings, ["t.obj:3: vertex colours are ignored (1 in all, the first on this line)"]);
    }
}
