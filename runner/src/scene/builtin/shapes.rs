//! Closed shapes, the clay of the built-in scenes.
//!
//! Every solid is watertight and faces outward. No shape calls the platform's `sin` or `cos`, which differ in the
//! last bits from one platform to the next.

use std::collections::HashMap;
use std::sync::LazyLock;

use glam::{Mat4, Vec3, vec3};

use crate::scene::Mesh;

/// Sine and cosine of an angle in turns, by polynomials in f64: at most one f32 rounding away from exact.
pub(super) fn sin_cos(turns: f32) -> (f32, f32) {
    let quarters = f64::from(turns) * 4.0;
    let nearest = quarters.round();
    let x = (quarters - nearest) * core::f64::consts::FRAC_PI_2;
    let xx = x * x;
    let sin = x * (1.0 - xx / 6.0 * (1.0 - xx / 20.0 * (1.0 - xx / 42.0 * (1.0 - xx / 72.0 * (1.0 - xx / 110.0)))));
    let cos = 1.0 - xx / 2.0 * (1.0 - xx / 12.0 * (1.0 - xx / 30.0 * (1.0 - xx / 56.0 * (1.0 - xx / 90.0))));
    let (sin, cos) = match (nearest as i64).rem_euclid(4) {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    };
    (sin as f32, cos as f32)
}

/// A turn about `axis` (of length 1), counter-clockwise seen from its tip.
pub(super) fn rotation(axis: Vec3, turns: f32) -> Mat4 {
    let (sin, cos) = sin_cos(turns);
    let column = |v: Vec3| (v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos))).extend(0.0);
    Mat4::from_cols(column(Vec3::X), column(Vec3::Y), column(Vec3::Z), glam::Vec4::W)
}

/// The point at `turns` on a circle in the xz plane: from +x towards -z, counter-clockwise seen from above.
pub(super) fn on_circle(radius: f32, turns: f32) -> Vec3 {
    let (sin, cos) = sin_cos(turns);
    vec3(radius * cos, 0.0, -radius * sin)
}

/// Two directions that complete a direction to a right-handed frame: `first x second = direction`.
pub(super) fn perpendiculars(direction: Vec3) -> (Vec3, Vec3) {
    let other = if direction.y.abs() < 0.9 { Vec3::Y } else { Vec3::X };
    let first = other.cross(direction).normalize();
    (first, direction.cross(first))
}

/// A mesh under construction.
pub(super) struct MeshBuilder {
    mesh: Mesh,
}

impl MeshBuilder {
    /// An empty mesh.
    pub(super) fn new(name: impl Into<String>) -> Self {
        Self { mesh: Mesh { name: name.into(), ..Mesh::default() } }
    }

    /// What has been built.
    pub(super) fn finish(self) -> Mesh {
        self.mesh
    }

    fn vertex(&mut self, position: Vec3, normal: Vec3) -> u32 {
        self.mesh.positions.push(position);
        self.mesh.normals.push(normal);
        self.mesh.positions.len() as u32 - 1
    }

    fn triangle(&mut self, corners: [u32; 3], material: u32) {
        self.mesh.triangles.push(corners);
        self.mesh.materials.push(material);
    }

    /// A flat quad, counter-clockwise seen from the front; not closed.
    pub(super) fn quad(&mut self, corners: [Vec3; 4], material: u32) {
        let normal = (corners[1] - corners[0]).cross(corners[3] - corners[0]).normalize();
        let [a, b, c, d] = corners.map(|corner| self.vertex(corner, normal));
        self.triangle([a, b, c], material);
        self.triangle([a, c, d], material);
    }

    /// A parallelogram of `columns` by `rows` quads, in front of `u` x `v`; not closed.
    pub(super) fn grid(&mut self, corner: Vec3, u: Vec3, v: Vec3, columns: u32, rows: u32, material: u32) {
        let normal = u.cross(v).normalize();
        let first = self.mesh.positions.len() as u32;
        for row in 0..=rows {
            for column in 0..=columns {
                let (s, t) = (column as f32 / columns as f32, row as f32 / rows as f32);
                self.vertex(corner + u * s + v * t, normal);
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let a = first + row * (columns + 1) + column;
                let c = a + columns + 2;
                self.triangle([a, a + 1, c], material);
                self.triangle([a, c, c - 1], material);
            }
        }
    }

    /// An axis-aligned box.
    pub(super) fn cuboid(&mut self, min: Vec3, max: Vec3, material: u32) {
        self.cuboid_in(Mat4::IDENTITY, min, max, material);
    }

    /// A box in a rigid frame of its own.
    pub(super) fn cuboid_in(&mut self, mesh_from_box: Mat4, min: Vec3, max: Vec3, material: u32) {
        let corner = |x: usize, y: usize, z: usize| {
            let pick = [min, max];
            mesh_from_box.transform_point3(vec3(pick[x].x, pick[y].y, pick[z].z))
        };
        let corners = [
            [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
            [(1, 0, 0), (0, 0, 0), (0, 1, 0), (1, 1, 0)],
            [(1, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1)],
            [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)],
            [(0, 1, 1), (1, 1, 1), (1, 1, 0), (0, 1, 0)],
            [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)],
        ];
        for face in corners {
            self.quad(face.map(|(x, y, z)| corner(x, y, z)), material);
        }
    }

    /// A straight rod of constant radius with flat ends.
    pub(super) fn tube(&mut self, from: Vec3, to: Vec3, radius: f32, sides: u32, material: u32) {
        self.frustum((from, radius), (to, radius), sides, 1, material);
    }

    /// A cone or a part of one, with flat ends; `to.1` may be 0 for a tip, `from.1` must be positive.
    /// The side has `sides` by `segments` quads.
    pub(super) fn frustum(&mut self, from: (Vec3, f32), to: (Vec3, f32), sides: u32, segments: u32, material: u32) {
        let along = to.0 - from.0;
        let axis = along.normalize();
        let (u, v) = perpendiculars(axis);
        let slope = (from.1 - to.1) / along.length();
        let radial = |side: u32| {
            let (sin, cos) = sin_cos((side % sides) as f32 / sides as f32);
            u * cos + v * sin
        };
        let point = |ring: u32, side: u32| {
            let t = ring as f32 / segments as f32;
            from.0.lerp(to.0, t) + radial(side) * (from.1 + (to.1 - from.1) * t)
        };

        let first = self.mesh.positions.len() as u32;
        for ring in 0..=segments {
            for side in 0..sides {
                self.vertex(point(ring, side), (radial(side) + axis * slope).normalize());
            }
        }
        for ring in 0..segments {
            for side in 0..sides {
                let a = first + ring * sides + side;
                let b = first + ring * sides + (side + 1) % sides;
                self.triangle([a, b, b + sides], material);
                if ring + 1 < segments || to.1 > 0.0 {
                    self.triangle([a, b + sides, a + sides], material);
                }
            }
        }
        for (ring, normal, is_open) in [(0, -axis, true), (segments, axis, to.1 > 0.0)] {
            if !is_open {
                continue;
            }
            let rim: Vec<u32> = (0..sides).map(|side| self.vertex(point(ring, side), normal)).collect();
            for pair in rim[1..].windows(2) {
                let corners = if ring == 0 { [rim[0], pair[1], pair[0]] } else { [rim[0], pair[0], pair[1]] };
                self.triangle(corners, material);
            }
        }
    }

    /// A ball of 20 (`level` 0), 80 (1) or 320 (2) triangles.
    pub(super) fn ball(&mut self, center: Vec3, radius: f32, level: usize, material: u32) {
        self.ellipsoid(center, Vec3::splat(radius), level, material);
    }

    /// A ball stretched along the axes.
    pub(super) fn ellipsoid(&mut self, center: Vec3, radii: Vec3, level: usize, material: u32) {
        let unit = &UNIT_BALLS[level];
        let first = self.mesh.positions.len() as u32;
        for &point in &unit.points {
            self.vertex(center + point * radii, (point / radii).normalize());
        }
        for &corners in &unit.triangles {
            self.triangle(corners.map(|corner| first + corner), material);
        }
    }

    /// A ring (torus) about `axis`, of length 1.
    pub(super) fn ring(&mut self, center: Vec3, axis: Vec3, radius: f32, thickness: f32, segments: u32, material: u32) {
        const SIDES: u32 = 6;
        let (u, v) = perpendiculars(axis);
        let first = self.mesh.positions.len() as u32;
        for segment in 0..segments {
            let (sin, cos) = sin_cos(segment as f32 / segments as f32);
            let outward = u * cos + v * sin;
            for side in 0..SIDES {
                let (sin, cos) = sin_cos(side as f32 / SIDES as f32);
                let normal = outward * cos + axis * sin;
                self.vertex(center + outward * radius + normal * thickness, normal.normalize());
            }
        }
        for segment in 0..segments {
            let (here, next) = (first + segment * SIDES, first + (segment + 1) % segments * SIDES);
            for side in 0..SIDES {
                let beside = (side + 1) % SIDES;
                self.triangle([here + side, next + side, next + beside], material);
                self.triangle([here + side, next + beside, here + beside], material);
            }
        }
    }
}

/// A subdivided icosahedron of radius 1.
struct UnitBall {
    points: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

static UNIT_BALLS: LazyLock<[UnitBall; 3]> = LazyLock::new(|| {
    let first = icosahedron();
    let second = first.subdivided();
    let third = second.subdivided();
    [first, second, third]
});

#[rustfmt::skip]
fn icosahedron() -> UnitBall {
    // (0, 1, golden ratio) scaled to length 1, its mirror images and its cyclic permutations.
    const A: f32 = 0.525_731_1;
    const B: f32 = 0.850_650_8;
    let points = [
        [-A, B, 0.0], [A, B, 0.0], [-A, -B, 0.0], [A, -B, 0.0],
        [0.0, -A, B], [0.0, A, B], [0.0, -A, -B], [0.0, A, -B],
        [B, 0.0, -A], [B, 0.0, A], [-B, 0.0, -A], [-B, 0.0, A],
    ];
    let triangles = [
        [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11],
        [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8],
        [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9],
        [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
    ];
    UnitBall { points: points.map(Vec3::from_array).to_vec(), triangles: triangles.to_vec() }
}

impl UnitBall {
    /// Each triangle in four, the new vertices moved out to the sphere.
    fn subdivided(&self) -> Self {
        let mut points = self.points.clone();
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((self.points[a as usize] + self.points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        let mut triangles = Vec::new();
        for &[a, b, c] in &self.triangles {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            triangles.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        Self { points, triangles }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every edge must be walked once each way; vertices are one where their positions are equal.
    fn is_watertight(mesh: &Mesh) -> bool {
        let mut balance: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
        let key = |vertex: u32| mesh.positions[vertex as usize].to_array().map(|x| (x + 0.0).to_bits());
        for &[a, b, c] in &mesh.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let (from, to) = (key(from), key(to));
                *balance.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
            }
        }
        balance.values().all(|&sum| sum == 0)
    }

    /// Six times the enclosed volume: positive where faces look outward.
    fn volume(mesh: &Mesh) -> f32 {
        mesh.triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    fn built(make: impl FnOnce(&mut MeshBuilder)) -> Mesh {
        let mut builder = MeshBuilder::new("test");
        make(&mut builder);
        builder.finish()
    }

    #[test]
    fn solids_are_watertight_and_face_outward() {
        let (from, to) = (vec3(0.2, -0.4, 0.1), vec3(0.7, 0.9, -0.3));
        let solids = [
            ("cuboid", built(|m| m.cuboid(vec3(-1.0, -2.0, -3.0), vec3(2.0, 1.0, 0.5), 0)), 31.5),
            ("turned", built(|m| m.cuboid_in(rotation(Vec3::Y, 0.1), -Vec3::ONE, Vec3::ONE, 0)), 8.0),
            ("tube", built(|m| m.tube(from, to, 0.2, 64, 0)), 0.1827),
            ("cone", built(|m| m.frustum((Vec3::ZERO, 1.0), (Vec3::Y * 3.0, 0.0), 96, 3, 0)), 3.1394),
            ("ball", built(|m| m.ball(from, 1.0, 2, 0)), 4.05),
            ("ring", built(|m| m.ring(from, Vec3::X, 1.0, 0.1, 64, 0)), 0.163),
        ];
        for (name, mesh, expected) in solids {
            assert!(is_watertight(&mesh), "{name} has a hole");
            let volume = volume(&mesh);
            assert!((volume - expected).abs() < 0.01 * expected, "{name} encloses {volume}, not {expected}");
        }
    }

    #[test]
    fn a_missing_face_counts_as_a_hole() {
        let mut mesh = built(|m| m.cuboid(Vec3::ZERO, Vec3::ONE, 0));
        mesh.triangles.pop();
        assert!(!is_watertight(&mesh));
    }

    #[test]
    fn balls_have_the_stated_triangle_counts() {
        let counts = [0, 1, 2].map(|level| built(|m| m.ball(Vec3::ZERO, 1.0, level, 0)).triangles.len());
        assert_eq!(counts, [20, 80, 320]);
    }

    #[test]
    fn sine_and_cosine_agree_with_the_platform() {
        for step in -2000..2000 {
            let turns = step as f32 / 777.0;
            let (sin, cos) = sin_cos(turns);
            let angle = f64::from(turns) * core::f64::consts::TAU;
            assert!((f64::from(sin) - angle.sin()).abs() < 1e-7, "sine at {turns} turns");
            assert!((f64::from(cos) - angle.cos()).abs() < 1e-7, "cosine at {turns} turns");
        }
    }
}
