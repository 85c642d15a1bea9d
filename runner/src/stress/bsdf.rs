//! Reflection and targets.

use glam::Vec3;
use weir_shared::{
    bsdf::Bsdf,
    numerics::{pack_unorm16, unit_float},
    octahedral,
    rng::pcg4d,
    surface::Surface,
};

use super::{
    Case, Check, Finding, Found,
    clip::{Clip, Take, Total},
    stage::{Stage, shining, white_sky},
};
use crate::{
    render::Backend,
    scene::{
        Material, environment,
        load::{LoadOptions, load_from},
        source::Memory,
    },
    technique::Technique,
};

pub(super) const CASES: &[Case] = &[
    Case {
        number: 48,
        name: "roughness from 0 over 1e-4 to 1, seen in the mirror's direction",
        expected: "finite, no fault; the mean of the reference",
        checks: &[Check::Host(peaks), Check::Frames(glossy)],
    },
    Case {
        number: 49,
        name: "albedo 0 and 1 under a white sky",
        expected: "exactly 0; 1 within noise",
        checks: &[Check::Frames(furnace)],
    },
    Case {
        number: 50,
        name: "blue light, and light without one of the channels",
        expected: "as by Lambert's formula; exactly 0 in the others",
        checks: &[Check::Frames(pure_colors)],
    },
    Case {
        number: 51,
        name: "numbers in files that are negative, above 1 or not numbers",
        expected: "in range after reading, with a warning for each",
        checks: &[Check::Host(read_numbers)],
    },
    Case {
        number: 52,
        name: "radiance of 1e6, beyond half floats",
        expected: "the mean to the last bit where it is seen, no fault",
        checks: &[Check::Frames(bright)],
    },
];

fn surface(diffuse: f32, specular: f32, roughness: f32, geometric: Vec3, shading: Vec3) -> Surface {
    Surface {
        normal_geometric: octahedral::pack(geometric),
        normal_shading: octahedral::pack(shading),
        specular_rg: pack_unorm16(specular) * 0x1_0001,
        specular_b_roughness: pack_unorm16(specular) | (pack_unorm16(roughness) << 16),
        diffuse: [diffuse; 3],
        instance: 0x8000_0000,
        ..Surface::default()
    }
}

/// Directions all over the sphere.
fn direction(i: u32, stream: u32) -> Vec3 {
    let [a, b, c, _] = pcg4d(i, stream, 6, 1).map(|x| unit_float(x) - 0.5);
    Vec3::new(a, b, c).normalize_or(Vec3::Y)
}

fn peaks() -> Finding {
    let (mut most, mut bad, mut count) = (0.0f32, 0, 0);
    for roughness in [0.0, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.3, 1.0] {
        for height in [1.0f32, 0.5, 0.1, 1e-2, 1e-4, 1e-6] {
            let view = Vec3::new((1.0 - height * height).max(0.0).sqrt(), height, 0.0);
            let bsdf = Bsdf::new(&surface(0.2, 1.0, roughness, Vec3::Y, Vec3::Y), view);
            let mirrored = Vec3::new(-view.x, view.y, 0.0);
            for i in 0..200u32 {
                let [a, b, c, _] = pcg4d(i, 1, 1, 1).map(unit_float);
                let incoming = if i == 0 { mirrored } else { bsdf.sample(a, b, c) };
                let value = bsdf.evaluate::<true>(incoming);
                let density = bsdf.pdf_solid_angle(incoming);
                most = most.max(value.max_element());
                count += 1;
                bad += u32::from(
                    !(value.is_finite() && value.min_element() >= 0.0 && density.is_finite() && density >= 0.0),
                );
            }
        }
    }
    Finding::new(bad == 0 && most > 1e4, format!("peak {most:.1e}; {bad} of {count} values negative or not finite"))
}

/// Light from and to grazing directions, with shading normals of any direction on the viewer's side.
pub fn grazing() -> Finding {
    let (mut bad, mut behind, mut lit) = (0, 0, 0);
    let count = 1_000_000;
    for i in 0..count {
        let geometric = direction(i, 1);
        let view = direction(i, 2);
        let (geometric, shading) = {
            let side = |n: Vec3| if n.dot(view) < 0.0 { -n } else { n };
            (side(geometric), side(direction(i, 3)))
        };
        let roughness = (i % 5) as f32 * 0.25;
        let bsdf = Bsdf::new(&surface(0.5, 0.5, roughness, geometric, shading), view);
        // Every other direction lies within a millionth of the horizon of one of the normals.
        let normal = if i % 4 == 0 { bsdf.normal } else { bsdf.normal_geometric };
        let any = direction(i, 4);
        let flat = (any - normal * any.dot(normal)).normalize_or(Vec3::X);
        let up = (unit_float(pcg4d(i, 5, 5, 5)[0]) - 0.5) * 4e-6;
        let incoming = if i % 2 == 0 { (flat + normal * up).normalize() } else { any };
        let value = bsdf.evaluate::<true>(incoming);
        let density = bsdf.pdf_solid_angle(incoming);
        let sound = |x: f32| x.is_finite() && x >= 0.0;
        bad += u32::from(!value.to_array().into_iter().all(sound) || !sound(density));
        let is_behind = bsdf.normal_geometric.dot(incoming) <= 0.0 || bsdf.normal.dot(incoming) <= 0.0;
        behind += u32::from(is_behind && value != Vec3::ZERO);
        lit += u32::from(value != Vec3::ZERO);
    }
    let text = format!("{bad} negative or not finite, {behind} from behind not 0, {lit} of {count} lit");
    Finding::new(bad + behind == 0 && lit > count / 20, text)
}

fn glossy(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    for (roughness, margin) in [(0.0, 0.1), (1e-4, 0.1), (0.1, 0.06), (1.0, 0.05)] {
        let mut stage = Stage::floor();
        stage.panel(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, shining(1e5));
        let floor = &mut stage.scene.materials[0];
        (floor.specular, floor.roughness, floor.metallic) = (Vec3::splat(0.8), roughness, 0.5);
        let take = Take::still(&stage.scene, Technique::Still, &["camera.jitter=off"]);
        let still = Clip::new(backend, &take)?.stills(64)?;
        let (agrees, text) = still.total().agrees(&take.judged(0, 4096)?, margin);
        findings.push(still.finding(agrees, format!("{roughness:e} {text}")));
    }
    Ok(Finding::all(findings))
}

fn furnace(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    for albedo in [0.0, 1.0] {
        let mut stage = Stage::floor();
        stage.scene.materials[0].base_color = Vec3::splat(albedo);
        stage.scene.environment = Some(white_sky());
        for technique in [Technique::Still, Technique::Candidates] {
            let still = Clip::new(backend, &stage.take(technique, &[]))?.stills(128)?;
            let total = still.total();
            let (holds, text) = if albedo == 0.0 {
                (total.mean == 0.0, total.mean.to_string())
            } else {
                total.agrees(&Total::exact(3.0 * 192.0), 0.02)
            };
            findings.push(still.finding(holds, format!("albedo {albedo} {text}")));
        }
    }
    Ok(Finding::all(findings))
}

fn pure_colors(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    for color in [Vec3::Z, Vec3::new(1.0, 0.0, 1.0)] {
        let mut stage = Stage::floor();
        // A white light beside it would drown what a luminance weighs with 0.07.
        stage.lamp(Vec3::new(-1.0, 2.0, -0.5), Vec3::X, Vec3::Z, Material { emission: color * 4.0, ..shining(1.0) });
        let (still, formula) = stage.measured(backend, Technique::Still, &[], 48)?;
        let (agrees, text) = still.total().agrees(&formula, 0.03);
        let absent = still.moments.iter().flat_map(|m| (0..3).map(|i| (color[i], m.mean[i])));
        let wrong = absent.filter(|(emitted, seen)| (*emitted == 0.0) != (*seen == 0.0)).count();
        findings.push(still.finding(agrees && wrong == 0, format!("{color} {text}, {wrong} channels wrong")));
    }
    Ok(Finding::all(findings))
}

/// An environment map of two texels as Radiance HDR can't hold such numbers: as OpenEXR.
fn sky_of(first: [f32; 3]) -> Vec<u8> {
    use exr::prelude::{Encoding, Image, Layer, LayerAttributes, SpecificChannels, WritableImage};
    let pixel = |at: exr::math::Vec2<usize>| if at.x() == 0 { (first[0], first[1], first[2]) } else { (1.0, 1.0, 1.0) };
    let layer = Layer::new((2, 1), LayerAttributes::default(), Encoding::UNCOMPRESSED, SpecificChannels::rgb(pixel));
    let mut file = std::io::Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut file).expect("memory");
    file.into_inner()
}

fn read_numbers() -> Finding {
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    let mut findings = Vec::new();
    for line in
        ["Kd -1 0.5 2", "Kd nan 0 0", "Ke -3 inf 1", "Ke 1e30 0 nan", "Ks 7 -7 nan", "Pr -2", "Pr nan", "Pm 9", "Ns -1"]
    {
        let mtl = format!("newmtl m\n{line}\n");
        let source = Memory::from_iter([("a.obj", obj), ("a.mtl", &mtl)]);
        let (holds, seen) = match load_from(&source, "a.obj", &LoadOptions::default()) {
            Ok(loaded) => (loaded.scene.validate().is_ok() && !loaded.warnings.is_empty(), loaded.warnings.len()),
            Err(_) => (false, 0),
        };
        findings.push((holds, format!("`{line}` {seen}")));
    }
    for texel in [[f32::NAN, 0.0, 1.0], [-1.0, 2.0, 3.0], [f32::INFINITY, 0.0, 0.0]] {
        let (holds, seen) = match environment::decode(&sky_of(texel), "sky.exr", 0.0, 1.0) {
            Ok((map, warnings)) => {
                let sound = map.texels.iter().flatten().all(|x| x.is_finite() && *x >= 0.0);
                (sound && !warnings.is_empty(), warnings.len())
            }
            Err(_) => (false, 0),
        };
        findings.push((holds, format!("texel {texel:?} {seen}")));
    }
    let holds = findings.iter().all(|f| f.0);
    let wrong: Vec<_> = findings.iter().filter(|f| !f.0).map(|f| f.1.as_str()).collect();
    let text = format!("{} inputs, not in range or without a warning: {}", findings.len(), wrong.join(", "));
    Finding::new(
        holds,
        if wrong.is_empty() { format!("{} inputs, all in range with warnings", findings.len()) } else { text },
    )
}

fn bright(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    stage.panel(Vec3::new(-0.3, 0.5, 0.3), Vec3::X * 0.6, Vec3::NEG_Z * 0.6, shining(1e6));
    let mut findings = Vec::new();
    for technique in [Technique::Still, Technique::RealTime] {
        let still = Clip::new(backend, &stage.take(technique, &[]))?.stills(300)?;
        let middle = still.moments[6 * 16 + 8].mean;
        findings.push(still.finding(middle == [1e6; 3], format!("{technique} {middle:?} after 300 frames")));
    }
    Ok(Finding::all(findings))
}
