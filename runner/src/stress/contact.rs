//! Cases in which things nearly touch, or are very large, small or far away.

use glam::{Mat4, Vec3};
use weir_shared::surface::Surface;

use super::{
    Finding, Found,
    clip::{Clip, Take, Total},
    scenes::quad,
    stage::{ALBEDO, Stage, shining},
};
use crate::{
    render::Backend,
    scene::{Camera, Material, Scene},
    technique::Technique,
};

/// A closed room with a lamp on its ceiling and a step on its floor, all corners at multiples of 1/8, so that they can be
/// moved far away without being rounded.
fn room() -> Scene {
    let camera =
        Camera { origin: Vec3::new(0.0, 1.0, 1.75), target: Vec3::new(0.0, 0.75, 0.0), up: Vec3::Y, vfov_deg: 70.0 };
    let mut stage = Stage::bare(camera);
    let gray = || Material { base_color: Vec3::splat(ALBEDO), ..Material::default() };
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 4.0);
    let low = Vec3::new(-1.0, 0.0, -2.0);
    stage.panel(low, z, x, gray());
    stage.panel(low + y, x, z, gray());
    stage.panel(low, x, y, gray());
    stage.panel(low + z, y, x, gray());
    stage.panel(low, y, z, gray());
    stage.panel(low + x, z, y, gray());
    stage.panel(Vec3::new(-0.5, 0.25, -0.5), Vec3::Z, Vec3::X * 0.5, gray());
    stage.panel(Vec3::new(-0.25, 1.875, -0.25), Vec3::X * 0.5, Vec3::Z * 0.5, shining(8.0));
    stage.scene
}

/// Mean picture, pixels that see sky, channels not lit, and faults.
fn picture(backend: &Backend<'_>, scene: &Scene) -> Result<(Total, usize, Finding), crate::render::RenderError> {
    let take = Take {
        size: [32, 24],
        outputs: &["surfaces", "color", "moments"],
        ..Take::still(scene, Technique::Still, &["camera.jitter=off"])
    };
    let mut clip = Clip::new(backend, &take)?;
    let still = clip.stills(32)?;
    let surfaces: Vec<Surface> = clip.output("surfaces")?;
    let sky = surfaces.iter().filter(|s| s.is_sky()).count();
    let dark = still.moments.iter().filter(|m| m.mean[0] == 0.0).count();
    Ok((still.total(), sky, still.finding(true, format!("{dark} dark pixels"))))
}

/// The room, every vertex scaled and then moved.
fn placed(scale: f32, offset: Vec3) -> Scene {
    let mut scene = room();
    for position in scene.meshes.iter_mut().flat_map(|m| &mut m.positions) {
        *position = *position * scale + offset;
    }
    if let Some(camera) = &mut scene.camera {
        (camera.origin, camera.target) = (camera.origin * scale + offset, camera.target * scale + offset);
    }
    scene
}

pub fn scales(backend: &Backend<'_>) -> Found {
    let (expected, _, _) = picture(backend, &placed(1.0, Vec3::ZERO))?;
    let mut findings = Vec::new();
    let far = Vec3::new(1e6, -1e6, 1e6);
    for (what, scene) in [
        ("1e-3", placed(1e-3, Vec3::ZERO)),
        ("1e6", placed(1e6, Vec3::ZERO)),
        ("1e6 away", placed(1.0, far)),
        ("1000 of size, 1e6 away", placed(1000.0, far)),
        ("1e6 away by instances", {
            let mut scene = room();
            scene.instances.iter_mut().for_each(|i| i.world_from_object = Mat4::from_translation(far));
            Scene { camera: placed(1.0, far).camera, ..scene }
        }),
    ] {
        let (total, sky, usable) = picture(backend, &scene)?;
        let (agrees, text) = total.agrees(&expected, 0.02);
        findings.push(Finding::all([Finding::new(agrees && sky == 0, format!("{what}: {text}, {sky} sky")), usable]));
    }
    Ok(Finding::all(findings))
}

pub fn on_a_wall(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    for gap in [1e-2, 1e-5] {
        let mut stage = Stage::floor();
        // A black wall along z, and a lamp before it that faces +x: y x z.
        let black = Material { base_color: Vec3::ZERO, ..Material::default() };
        stage.panel(Vec3::new(-0.6, 0.0, -2.0), Vec3::Y * 2.0, Vec3::Z * 4.0, black);
        stage.lamp(Vec3::new(-0.6 + gap, 0.3, -0.5), Vec3::Y * 0.6, Vec3::Z, shining(3.0));
        let (still, formula) = stage.measured(backend, Technique::Still, &[], 48)?;
        let (agrees, text) = still.total().agrees(&formula, 0.03);
        findings.push(still.finding(agrees, format!("{gap:e} before it {text}")));
        // Seen from the front: nothing but the lamp.
        let mut scene = stage.scene.clone();
        scene.camera = Some(Camera {
            origin: Vec3::new(1.0, 0.6, 0.0),
            target: Vec3::new(-0.6, 0.6, 0.0),
            up: Vec3::Y,
            vfov_deg: 15.0,
        });
        let take = Take { size: [64, 48], ..Take::still(&scene, Technique::Candidates, &[]) };
        let front = Clip::new(backend, &take)?.stills(4)?;
        let other = front.channels().filter(|x| *x != 3.0).count();
        findings.push(front.finding(other == 0, format!("{other} channels from the wall")));
    }
    Ok(Finding::all(findings))
}

pub fn standing_on_the_floor(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    // Faces -x: z x y.
    stage.lamp(Vec3::new(0.25, 0.0, -1.0), Vec3::Z * 2.0, Vec3::Y * 0.5, shining(3.0));
    let mut findings = Vec::new();
    for (what, target, vfov_deg, margin) in [("floor", Vec3::ZERO, 40.0, 0.03), ("edge", Vec3::X * 0.249, 0.1, 0.05)] {
        let origin = Vec3::new(-0.3, 1.0, 0.0);
        stage.scene.camera = Some(Camera { origin, target, up: Vec3::NEG_Z, vfov_deg });
        let mut clip = Clip::new(backend, &stage.take(Technique::Still, &[]))?;
        clip.show(0, |_| ())?;
        let surfaces: Vec<Surface> = clip.output("surfaces")?;
        // What the lamp itself shows is no matter of the floor.
        let lit = clip.stills_of(400, |pixel| !surfaces[pixel].is_sky() && surfaces[pixel].instance() == 0)?;
        let dark = lit.moments.iter().filter(|m| m.mean[0] == 0.0).count();
        let behind = surfaces.iter().filter(|s| s.instance() == 0 && s.position[0] > 0.25).count();
        let (agrees, text) = lit.total().agrees(&stage.formula(&surfaces), margin);
        let holds = agrees && dark == 0 && behind == 0;
        findings.push(lit.finding(holds, format!("{what} {text}, {dark} dark pixels of {}", lit.moments.len())));
    }
    Ok(Finding::all(findings))
}

pub fn thin_wall(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    for technique in [Technique::Still, Technique::RealTime] {
        let mut stage = Stage::floor();
        let gray = Material { base_color: Vec3::splat(ALBEDO), ..Material::default() };
        // Two faces, 1e-4 apart, from below the floor to above the camera, and a lid over the dark side.
        stage.panel(Vec3::new(0.0, -0.1, -2.0), Vec3::Y * 4.0, Vec3::Z * 4.0, gray.clone());
        stage.panel(Vec3::new(-1e-4, -0.1, -2.0), Vec3::Z * 4.0, Vec3::Y * 4.0, gray);
        // In the bright room, facing the wall: z x y.
        stage.panel(Vec3::new(1.0, 0.1, -1.0), Vec3::Z * 2.0, Vec3::Y, shining(1e6));
        stage.scene.camera = Some(Camera {
            origin: Vec3::new(-0.4, 1.0, 0.0),
            target: Vec3::new(-0.2, 0.0, 0.0),
            up: Vec3::NEG_Z,
            vfov_deg: 50.0,
        });
        let take = Take { size: [64, 48], ..Take::still(&stage.scene, technique, &[]) };
        let still = Clip::new(backend, &take)?.stills(8)?;
        let lit = still.channels().filter(|x| *x != 0.0).count();
        findings.push(still.finding(lit == 0, format!("{technique}: {lit} channels lit behind it")));
    }
    // Before it, the wall takes nothing away.
    let mut stage = Stage::floor();
    let black = Material { base_color: Vec3::ZERO, ..Material::default() };
    stage.panel(Vec3::new(0.48, -0.1, -2.0), Vec3::Z * 4.0, Vec3::Y * 4.0, black);
    stage.lamp(Vec3::new(-0.5, 2.0, -0.5), Vec3::X * 0.5, Vec3::Z, shining(1e4));
    let (still, formula) = stage.measured(backend, Technique::Still, &[], 48)?;
    let (agrees, text) = still.total().agrees(&formula, 0.03);
    findings.push(still.finding(agrees, format!("before it {text}")));
    Ok(Finding::all(findings))
}

pub fn coincident(backend: &Backend<'_>) -> Found {
    let (corner, a, b) = (Vec3::new(-0.5, 1.7, -0.5), Vec3::X, Vec3::Z);
    let mut findings = Vec::new();
    for first in [false, true] {
        for facing_down in [false, true] {
            let mut stage = Stage::floor();
            let black = || Material { base_color: Vec3::ZERO, ..Material::default() };
            let sides = if facing_down { (a, b) } else { (b, a) };
            if first {
                stage.panel(corner, sides.0, sides.1, black());
            }
            stage.lamp(corner, a, b, shining(4.0));
            if !first {
                stage.panel(corner, sides.0, sides.1, black());
            }
            let (still, formula) = stage.measured(backend, Technique::Still, &["candidates.bsdf=0"], 32)?;
            let (agrees, text) = still.total().agrees(&formula, 0.03);
            findings.push(still.finding(agrees, text));
        }
    }
    // In one mesh, so that the tree itself holds both.
    let mut stage = Stage::floor();
    stage.lamp(corner, a, b, shining(4.0));
    let lamp = stage.scene.meshes.last_mut().expect("a lamp has a mesh");
    let double = quad("double", corner, a, b, 0);
    lamp.triangles.extend(double.triangles);
    lamp.materials.extend([0, 0]);
    let (still, formula) = stage.measured(backend, Technique::Still, &["candidates.bsdf=0"], 32)?;
    let (agrees, text) = still.total().agrees(&formula, 0.03);
    findings.push(still.finding(agrees, format!("in one mesh {text}")));
    Ok(Finding::all(findings))
}
