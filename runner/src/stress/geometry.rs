//! Geometry and rays.

use std::time::Instant;

use glam::{Mat3, Mat4, Quat, Vec3};
use weir_shared::{
    bsdf::basis,
    bvh,
    numerics::unit_float,
    ray::{FAR, Ray},
    rng::pcg4d,
    scene::Scene as SceneView,
    surface::Surface,
    triangle::ShearedRay,
};

use super::{
    Case, Check, Finding, Found,
    clip::{Clip, Take},
    contact,
    stage::{Stage, shining, white_sky},
};
use crate::{
    packed::PackedScene,
    render::Backend,
    scene::{Camera, Instance, Material, Mesh, Motion, Scene},
    technique::Technique,
};

pub(super) const CASES: &[Case] = &[
    Case {
        number: 37,
        name: "a million rays to edges and corners of a closed mesh, from within; a picture from within",
        expected: "no ray leaks",
        checks: &[Check::Host(edges_and_corners), Check::Frames(from_within)],
    },
    Case {
        number: 38,
        name: "rays along the axes, with components of 0 and -0, that start on planes of boxes",
        expected: "what all triangles, one by one, give",
        checks: &[Check::Host(along_axes)],
    },
    Case {
        number: 39,
        name: "a scene at scales 1e-3, 1 and 1e6, and 1e6 away from the origin",
        expected: "the same picture within noise, no sky in a closed room",
        checks: &[Check::Frames(contact::scales)],
    },
    Case {
        number: 40,
        name: "a lamp 1e-5 before a wall",
        expected: "the floor is lit as by Lambert's formula, the lamp shows no wall",
        checks: &[Check::Frames(contact::on_a_wall)],
    },
    Case {
        number: 41,
        name: "a lamp that stands on the floor",
        expected: "the floor is lit as by Lambert's formula, up to the edge",
        checks: &[Check::Frames(contact::standing_on_the_floor)],
    },
    Case {
        number: 42,
        name: "light at grazing angles, shading normals against geometric ones",
        expected: "0 or finite, never negative; the mean of the reference",
        checks: &[Check::Host(super::bsdf::grazing), Check::Frames(bent_normals)],
    },
    Case {
        number: 43,
        name: "bases of normals at and near the poles",
        expected: "orthonormal to 1e-6",
        checks: &[Check::Host(poles)],
    },
    Case {
        number: 44,
        name: "a lamp under a mirroring transform of unequal scales",
        expected: "shines to the same side, as by Lambert's formula",
        checks: &[Check::Frames(mirrored)],
    },
    Case {
        number: 45,
        name: "a wall of 1e-4 before a bright room",
        expected: "exactly black behind it; the mean of the formula before it",
        checks: &[Check::Frames(contact::thin_wall)],
    },
    Case {
        number: 46,
        name: "a lamp in the plane of another panel",
        expected: "it is not hidden: the mean of Lambert's formula",
        checks: &[Check::Frames(contact::coincident)],
    },
    Case {
        number: 47,
        name: "100,000 instances, and as many triangles with one center",
        expected: "builds within 10 s, rays find what is there",
        checks: &[Check::Host(crowds), Check::Frames(many_instances)],
    },
];

/// A closed ball of radius 1 around the origin, seen from within.
fn ball(rings: u32) -> Mesh {
    let segments = 2 * rings;
    let mut mesh = Mesh { name: "ball".into(), ..Mesh::default() };
    let corner = |ring: u32, segment: u32| {
        if ring == 0 {
            0
        } else if ring == rings {
            1
        } else {
            2 + (ring - 1) * segments + segment % segments
        }
    };
    mesh.positions = vec![Vec3::Y, Vec3::NEG_Y];
    for ring in 1..rings {
        for segment in 0..segments {
            let polar = core::f64::consts::PI * f64::from(ring) / f64::from(rings);
            let azimuth = core::f64::consts::TAU * f64::from(segment) / f64::from(segments);
            let p = glam::DVec3::new(polar.sin() * azimuth.cos(), polar.cos(), polar.sin() * azimuth.sin());
            mesh.positions.push(p.as_vec3());
        }
    }
    for ring in 0..rings {
        for segment in 0..segments {
            let [a, b] = [corner(ring, segment), corner(ring, segment + 1)];
            let [c, d] = [corner(ring + 1, segment), corner(ring + 1, segment + 1)];
            if ring > 0 {
                mesh.triangles.push([a, b, c]);
            }
            if ring + 1 < rings {
                mesh.triangles.push([b, d, c]);
            }
        }
    }
    mesh.materials = vec![0; mesh.triangles.len()];
    mesh
}

/// A scene of one mesh, in place.
fn alone(mesh: Mesh) -> Scene {
    Scene {
        name: "alone".into(),
        meshes: vec![mesh],
        instances: vec![Instance { mesh: 0, world_from_object: Mat4::IDENTITY, motion: Motion::Still }],
        materials: vec![Material::default()],
        ..Scene::default()
    }
}

/// Packs a scene that is known to fit.
fn packed(scene: &Scene) -> PackedScene {
    PackedScene::new(scene, 0.0).expect("a scene of the list packs")
}

/// The nearest hit in a packed scene without instances or masks.
fn closest(packed: &PackedScene, ray: &Ray) -> weir_shared::ray::Hit {
    let view = SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels };
    bvh::closest_hit::<false, false>(&packed.frame, &view, &packed.bvh, ray)
}

/// Rays from within a ball of some ten thousand triangles to points of its edges and to its corners: how many leak.
/// `shift`: where it is.
pub fn leaks(shift: Vec3, rays: u32) -> u32 {
    use rayon::prelude::*;
    let mut mesh = ball(72);
    mesh.positions.iter_mut().for_each(|p| *p += shift);
    let scene = alone(mesh);
    let packed = packed(&scene);
    let mesh = &scene.meshes[0];
    let is_leak = |i: &u32| {
        let [a, b, c, d] = pcg4d(*i, 3, 7, 2);
        let corners = mesh.triangles[a as usize % mesh.triangles.len()].map(|v| mesh.positions[v as usize]);
        let (from, to) = (corners[b as usize % 3], corners[(b as usize + 1) % 3]);
        // Every fourth ray goes to a corner.
        let share = if i.is_multiple_of(4) { 0.0 } else { unit_float(c) };
        let target = from + (to - from) * share;
        let origin = shift + Vec3::new(unit_float(d) - 0.5, unit_float(d << 8) - 0.5, unit_float(d << 16) - 0.5);
        let direction = target - origin;
        let ray = Ray { origin: origin - packed.origin, direction, t_max: FAR };
        direction.length_squared() > 0.0 && closest(&packed, &ray).is_miss()
    };
    (0..rays).into_par_iter().filter(is_leak).count() as u32
}

fn edges_and_corners() -> Finding {
    let rays = 1_000_000;
    let leaks = leaks(Vec3::ZERO, rays);
    Finding::new(leaks == 0, format!("{leaks} of {rays} rays leak"))
}

fn from_within(backend: &Backend<'_>) -> Found {
    let mut scene = alone(ball(72));
    scene.environment = Some(white_sky());
    scene.camera = Some(Camera { origin: Vec3::splat(0.1), target: Vec3::Y, up: Vec3::X, vfov_deg: 150.0 });
    let take = Take {
        size: [192, 192],
        outputs: &["surfaces", "color", "moments"],
        ..Take::still(&scene, Technique::Candidates, &["candidates.count=1"])
    };
    let mut clip = Clip::new(backend, &take)?;
    let still = clip.stills(4)?;
    let surfaces: Vec<Surface> = clip.output("surfaces")?;
    let sky = surfaces.iter().filter(|s| s.is_sky()).count();
    let lit = still.channels().filter(|x| *x > 0.0).count();
    Ok(still.finding(sky == 0 && lit == 0, format!("{sky} pixels see out, {lit} channels lit from outside")))
}

fn along_axes() -> Finding {
    // Boxes with corners at whole numbers, so that origins lie on planes of the tree.
    let mut mesh = Mesh { name: "steps".into(), ..Mesh::default() };
    for i in 0..200u32 {
        let [a, b, c, d] = pcg4d(i, 1, 2, 3).map(|x| (x >> 29) as f32);
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([Vec3::new(a, b, c), Vec3::new(a + 1.0, b, c + d), Vec3::new(a, b + 1.0, c - d)]);
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.materials.push(0);
    }
    let packed = packed(&alone(mesh));
    let count = packed.triangles.len() as u32 / 9;
    let (mut differ, mut hits, mut rays) = (0, 0, 0);
    for i in 0..20_000u32 {
        let [a, b, c, d] = pcg4d(i, 5, 2, 3);
        let origin = Vec3::new((a >> 29) as f32, (b >> 29) as f32, (c >> 29) as f32);
        let zero = |bit: u32| if d >> bit & 1 == 0 { 0.0 } else { -0.0 };
        let length = if d >> 4 & 1 == 0 { 1.0 } else { -1.0 };
        let mut direction = Vec3::new(zero(0), zero(1), zero(2));
        direction[(d >> 8) as usize % 3] = length;
        if d >> 5 & 1 == 0 {
            direction[(d >> 9) as usize % 3] = length;
        }
        let ray = Ray { origin, direction, t_max: FAR };
        let found = closest(&packed, &ray);
        let sheared = ShearedRay::new(origin, direction);
        let mut nearest = FAR;
        for triangle in 0..count {
            let t = sheared.intersect(&packed.triangles, triangle).t;
            if t > 0.0 && t < nearest {
                nearest = t;
            }
        }
        rays += 1;
        hits += u32::from(nearest < FAR);
        differ += u32::from(found.is_miss() != (nearest == FAR) || found.t != nearest);
    }
    Finding::new(differ == 0 && hits > 1000, format!("{differ} of {rays} rays differ, {hits} hit"))
}

fn poles() -> Finding {
    let below = f32::from_bits((-1.0f32).to_bits() - 1);
    let mut normals = vec![Vec3::NEG_Z, Vec3::Z, Vec3::new(0.6, -0.8, -0.0), Vec3::new(1.0, 0.0, -0.0)];
    for z in [-1.0 + 1e-7, below, -1.0 + 1e-6, 1.0 - 1e-7, -1e-30, 1e-30] {
        let radius = (1.0 - f64::from(z) * f64::from(z)).sqrt() as f32;
        normals.extend((0..16).map(|i| {
            let (sine, cosine) = (i as f32 * 0.4).sin_cos();
            Vec3::new(radius * cosine, radius * sine, z)
        }));
    }
    normals.extend((0..1_000_000u32).map(|i| {
        let [a, b, c, _] = pcg4d(i, 4, 4, 4).map(|x| unit_float(x) - 0.5);
        Vec3::new(a, b, c).normalize_or(Vec3::Y)
    }));
    let mut worst = 0.0f64;
    for n in &normals {
        let (t, b) = basis(*n);
        let [n, t, b] = [n, &t, &b].map(|v| v.as_dvec3());
        let off = [t.dot(b), t.dot(n), b.dot(n), t.length() - 1.0, b.length() - 1.0].map(f64::abs);
        worst = off.into_iter().fold(worst, f64::max);
    }
    Finding::new(worst < 1e-6, format!("{worst:.1e} off at most over {} normals", normals.len()))
}

fn mirrored(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    for scale in [Vec3::new(-2.0, 1.0, 0.5), Vec3::new(0.3, -1.0, 2.0), Vec3::new(-1.0, -1.0, -1.5)] {
        let mut stage = Stage::floor();
        // Faces down, before and after the transform: a mirror keeps the front in front.
        let up = scale.y < 0.0;
        let (a, b) = if up { (Vec3::Z, Vec3::X) } else { (Vec3::X, Vec3::Z) };
        let corner = Vec3::new(-0.5, 0.0, -0.5);
        let lamp = stage.panel(corner, a, b, shining(3.0));
        let turn = Mat3::from_quat(Quat::from_rotation_x(0.2));
        let linear = turn * Mat3::from_diagonal(scale);
        let place = Mat4::from_translation(Vec3::new(0.1, 1.8, 0.0)) * Mat4::from_mat3(linear);
        stage.scene.instances[lamp as usize].world_from_object = place;
        let corners = [corner, corner + a, corner + a + b, corner + b].map(|p| place.transform_point3(p).as_dvec3());
        stage.knows(corners, 9.0);
        let (still, formula) = stage.measured(backend, Technique::Still, &[], 48)?;
        let (agrees, text) = still.total().agrees(&formula, 0.03);
        findings.push(still.finding(agrees, format!("{scale} {text}")));
    }
    Ok(Finding::all(findings))
}

/// A floor whose shading normals point in all directions.
fn bent_normals(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    stage.panel(Vec3::new(-0.5, 1.5, -0.5), Vec3::X, Vec3::Z, shining(5.0));
    let mut findings = Vec::new();
    for normals in [
        [Vec3::NEG_Y, Vec3::NEG_Y, Vec3::NEG_Y, Vec3::NEG_Y],
        [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::Y],
        [Vec3::new(1.0, 1e-6, 0.0), Vec3::new(1.0, -1e-6, 0.0), Vec3::X, Vec3::new(0.9, 0.1, 0.0)],
    ] {
        stage.scene.meshes[0].normals = normals.map(Vec3::normalize).to_vec();
        let take = Take::still(&stage.scene, Technique::Still, &[]);
        let still = Clip::new(backend, &take)?.stills(64)?;
        let (agrees, text) = still.total().agrees(&take.judged(0, 4096)?, 0.05);
        findings.push(still.finding(agrees, text));
    }
    Ok(Finding::all(findings))
}

const CROWD: u32 = 100_000;

fn crowds() -> Finding {
    let start = Instant::now();
    let triangle =
        |size: f32| [Vec3::new(-size, -size, 0.0), Vec3::new(size, -size, 0.0), Vec3::new(0.0, 2.0 * size, 0.0)];
    let mut mesh = Mesh { name: "crowd".into(), ..Mesh::default() };
    for i in 0..CROWD {
        mesh.positions.extend(triangle(1.0 + i as f32 * 1e-5));
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        mesh.materials.push(0);
    }
    let centered = packed(&alone(mesh));
    let ray = Ray { origin: Vec3::new(0.1, 0.1, 3.0), direction: Vec3::NEG_Z, t_max: FAR };
    let found = closest(&centered, &ray).t;
    // And one after the other in the same place, as instances.
    let mut scene = alone(Mesh {
        positions: triangle(1.0).to_vec(),
        triangles: vec![[0, 1, 2]],
        materials: vec![0],
        ..Mesh::default()
    });
    scene.instances = vec![scene.instances[0].clone(); CROWD as usize];
    let stacked = packed(&scene);
    let view = SceneView { triangles: &stacked.triangles, records: &stacked.records, texels: &stacked.texels };
    let through = bvh::closest_hit::<false, true>(&stacked.frame, &view, &stacked.bvh, &ray);
    let seconds = start.elapsed().as_secs_f64();
    // The nearest of 100,000 results, each off by as many ulp as the intersection states: six of them.
    let is_near = (found - 3.0).abs() <= 6.0 * 2.0 * f32::EPSILON;
    let holds = is_near && through.t == 3.0 && through.instance == 0 && seconds < 10.0;
    Finding::new(
        holds,
        format!("built in {seconds:.1} s, t = {found} and {}, instance {}", through.t, through.instance),
    )
}

fn many_instances(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    stage.lamp(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, shining(4.0));
    let speck = stage.panel(Vec3::ZERO, Vec3::X * 1e-3, Vec3::Z * 1e-3, Material::default());
    let mesh = stage.scene.instances[speck as usize].mesh;
    // Above the lamp, where nothing sees them.
    (1..CROWD).for_each(|i| {
        let [x, y, z, _] = pcg4d(i, 2, 2, 2).map(unit_float);
        stage.place(mesh, Mat4::from_translation(Vec3::new(4.0 * x - 2.0, 3.0 + y, 4.0 * z - 2.0)));
    });
    stage.scene.instances[speck as usize].world_from_object = Mat4::from_translation(Vec3::Y * 3.0);
    let (still, formula) = stage.measured(backend, Technique::Still, &[], 24)?;
    let (agrees, text) = still.total().agrees(&formula, 0.04);
    Ok(still.finding(agrees, text))
}
