//! Triangles, normals and lobes.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use weir_shared::{
    bsdf::Bsdf,
    numerics::{pack_unorm16, unit_float},
    octahedral,
    rng::pcg4d,
    surface::Surface,
    triangle::{ShearedRay, square_to_triangle, triangle_to_square},
};

use crate::{Worst, assert_stated, ulp};

/// A vector with coordinates in -1..1.
fn vector(i: u32, stream: u32) -> Vec3 {
    let [a, b, c, _] = pcg4d(i, stream, 5, 9).map(|x| 2.0 * unit_float(x) - 1.0);
    Vec3::new(a, b, c)
}

/// Distance and weights where a ray meets a plane. Source: Moller and Trumbore 1997, in `f64`.
fn exact_hit(origin: Vec3, direction: Vec3, [a, b, c]: [Vec3; 3]) -> [f64; 3] {
    let [origin, direction, a, b, c] = [origin, direction, a, b, c].map(|v| v.as_dvec3());
    let (ab, ac, from) = (b - a, c - a, origin - a);
    let p = direction.cross(ac);
    let q = from.cross(ab);
    let determinant = ab.dot(p);
    [ac.dot(q), from.dot(p), direction.dot(q)].map(|x| x / determinant)
}

/// Rays from a distance of about 3 to triangles of size about 1, not edge-on.
#[test]
fn hits_of_triangles() {
    let none = [Worst::default(); 3];
    let of = |mut worst: [Worst; 3], i: u32| {
        let corners = [vector(i, 1), vector(i, 2), vector(i, 3)];
        let origin = vector(i, 4).normalize_or(Vec3::X) * 3.0;
        let (u, v) = square_to_triangle(unit_float(pcg4d(i, 6, 6, 6)[0]), unit_float(pcg4d(i, 6, 6, 6)[1]));
        let toward = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v;
        let direction = (toward - origin).normalize();
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        if normal.length() < 0.3 || normal.normalize().dot(direction).abs() < 0.3 {
            return worst;
        }
        let mut triangle = [0.0; 9];
        corners.iter().zip(triangle.chunks_exact_mut(3)).for_each(|(c, at)| c.write_to_slice(at));
        let hit = ShearedRay::new(origin, direction).intersect(&triangle, 0);
        if hit.t > 0.0 {
            let exact = exact_hit(origin, direction, corners);
            for (worst, (seen, exact)) in worst.iter_mut().zip([hit.t, hit.u, hit.v].into_iter().zip(exact)) {
                // Weights next to 0 have as few digits as those next to 1: their ulp is that of 1.
                let error = (f64::from(seen) - exact).abs() / ulp(exact.max(1.0));
                worst.absolute = worst.absolute.max((f64::from(seen) - exact).abs());
                if error > worst.ulps {
                    (worst.ulps, worst.at) = (error, f64::from(i));
                }
            }
        }
        worst
    };
    let merge = |a: [Worst; 3], b: [Worst; 3]| std::array::from_fn(|i| a[i].merged(b[i]));
    let [t, u, v] = (0..4_000_000u32).into_par_iter().fold(|| none, of).reduce(|| none, merge);
    assert_stated("distance of a hit", t, 6.0);
    assert_stated("weight of the second corner, in ulp of 1", u, 32.0);
    assert_stated("weight of the third corner, in ulp of 1", v, 32.0);
}

#[test]
fn maps_between_square_and_triangle() {
    let (mut there, mut back) = (0.0f64, 0.0f64);
    for i in 0..4_000_000u32 {
        let [u, v, ..] = pcg4d(i, 2, 1, 1).map(unit_float);
        let (b, c) = square_to_triangle(u, v);
        let exact = if v > u {
            (f64::from(u) / 2.0, f64::from(v) - f64::from(u) / 2.0)
        } else {
            (f64::from(u) - f64::from(v) / 2.0, f64::from(v) / 2.0)
        };
        there = there.max((f64::from(b) - exact.0).abs()).max((f64::from(c) - exact.1).abs());
        assert!(b >= 0.0 && c >= 0.0 && b + c <= 1.0);
        let (u_again, v_again) = triangle_to_square(b, c);
        back = back.max(f64::from((u_again - u).abs())).max(f64::from((v_again - v).abs()));
    }
    println!("square to triangle {there:.1e} absolute, and back {back:.1e}");
    assert!(there <= 2f64.powi(-25) && back <= 2f64.powi(-23));
}

#[test]
fn packed_normals() {
    let angle = |i: u32| {
        let n = vector(i, 7).as_dvec3();
        if n.length() < 0.1 {
            return 0.0;
        }
        let n = n.normalize();
        let packed = octahedral::unpack(octahedral::pack(n.as_vec3())).as_dvec3();
        assert!((packed.length() - 1.0).abs() < 2e-7);
        n.cross(packed).length().asin().to_degrees()
    };
    let worst = (0..4_000_000u32).into_par_iter().map(angle).reduce(|| 0.0, f64::max);
    println!("packed normal: {worst:.5} degrees");
    assert!(worst < 0.004 && worst > 0.002);
}

/// The BSDF times cosine, and the density of its directions, for a metal of given alpha: as the module states them, in
/// `f64`.
fn exact_metal(specular: f64, alpha: f64, outgoing: DVec3, incoming: DVec3) -> [f64; 2] {
    use core::f64::consts::{FRAC_1_PI, PI};
    let half = (outgoing + incoming).normalize();
    let a2 = alpha * alpha;
    let (view, light, cosine) = (outgoing.z.max(f64::from(1e-4f32)), incoming.z, half.z.max(0.0));
    let d = (half.x * half.x + half.y * half.y) + a2 * cosine * cosine;
    let density = a2 / (PI * d * d);
    let smith = |x: f64| (a2 + (1.0 - a2) * x * x).sqrt();
    let fresnel = |c: f64| specular + (1.0 - specular) * (1.0 - c).powi(5);
    let reflected =
        fresnel(half.dot(incoming).max(0.0)) * density * 0.5 / (light * smith(view) + view * smith(light)) * light;
    // No diffuse lobe: the share of the other is 0.9.
    let masked = density * 2.0 / (view + smith(view)) * 0.25;
    [reflected, 0.9 * masked + 0.1 * FRAC_1_PI * light]
}

#[test]
fn lobes() {
    for (roughness, stated) in [1.0f32, 0.5, 0.1, 0.03].map(|roughness| (roughness, 18.0)) {
        let code = pack_unorm16(roughness);
        let specular = pack_unorm16(0.6);
        let up = octahedral::pack(Vec3::Z);
        let surface = Surface {
            normal_geometric: up,
            normal_shading: up,
            specular_rg: specular * 0x1_0001,
            specular_b_roughness: specular | code << 16,
            instance: 0x8000_0000,
            ..Surface::default()
        };
        let alpha = (f64::from(code) / 65_535.0).powi(2).max(1e-3);
        let none = [Worst::default(); 2];
        let of = |mut worst: [Worst; 2], i: u32| {
            let outgoing = vector(i, 8).normalize_or(Vec3::Z);
            let outgoing = outgoing.with_z(outgoing.z.abs().max(0.05)).normalize();
            let bsdf = Bsdf::new(&surface, outgoing);
            let [a, b, c, _] = pcg4d(i, 9, 9, 9).map(unit_float);
            let incoming = bsdf.sample(a, b, c);
            if incoming.z > 0.05 {
                let exact =
                    exact_metal(f64::from(specular) / 65_535.0, alpha, outgoing.as_dvec3(), incoming.as_dvec3());
                let seen = [bsdf.evaluate::<true>(incoming).x, bsdf.pdf_solid_angle(incoming)];
                for (worst, (seen, exact)) in worst.iter_mut().zip(seen.into_iter().zip(exact)) {
                    worst.add(f64::from(i), seen, exact);
                }
            }
            worst
        };
        let merge = |a: [Worst; 2], b: [Worst; 2]| std::array::from_fn(|i| a[i].merged(b[i]));
        let [value, density] = (0..1_000_000u32).into_par_iter().fold(|| none, of).reduce(|| none, merge);
        assert_stated(&format!("BSDF at roughness {roughness}"), value, stated);
        assert_stated(&format!("its density at roughness {roughness}"), density, stated);
    }
}
