//! The material library.

use std::collections::HashSet;
use std::io::{self, Write};

use glam::Vec3;

use super::file_stem;
use crate::scene::{Material, Scene};

/// One name for each material: its own where that can stand in a file and is not taken, else with its index appended.
pub(super) fn unique_names(scene: &Scene) -> Vec<String> {
    let mut taken = HashSet::new();
    let mut names = Vec::with_capacity(scene.materials.len());
    for (index, material) in scene.materials.iter().enumerate() {
        let stem = file_stem(&material.name);
        let mut name = stem.clone();
        let mut suffix = index;
        while !taken.insert(name.clone()) {
            name = format!("{stem}-{suffix}");
            suffix += 1;
        }
        names.push(name);
    }
    names
}

/// Writes every material of the scene.
pub(super) fn write(scene: &Scene, names: &[String], texture_names: &[String], out: &mut impl Write) -> io::Result<()> {
    for (material, name) in scene.materials.iter().zip(names) {
        writeln!(out, "newmtl {name}")?;
        write_color(out, "Kd", material.base_color)?;
        write_specular(out, material)?;
        if material.emission != Vec3::ZERO {
            write_color(out, "Ke", material.emission)?;
            if material.two_sided_emission {
                writeln!(out, "# emits from both faces, which MTL cannot say")?;
            }
        }
        let maps = [
            ("map_Kd", material.base_color_texture),
            ("map_Ke", material.emission_texture),
            ("map_d", material.alpha_texture),
        ];
        for (key, texture) in maps {
            if let Some(texture) = texture {
                writeln!(out, "{key} {}", texture_names[texture as usize])?;
            }
        }
        writeln!(out)?;
    }
    Ok(())
}

/// The specular lobe in the terms of both kinds of reader: a Phong exponent, and roughness with refractive index.
fn write_specular(out: &mut impl Write, material: &Material) -> io::Result<()> {
    let Material { specular, roughness, metallic, .. } = *material;
    if specular == Vec3::ZERO && metallic == 0.0 {
        write_color(out, "Ks", Vec3::ZERO)?;
        return writeln!(out, "illum 1");
    }

    let ks = specular.lerp(material.base_color, metallic);
    write_color(out, "Ks", ks)?;
    // Source: Walter et al. 2007, the Phong exponent of the same width as a microfacet lobe; alpha = roughness^2.
    let exponent = (2.0 / roughness.powi(4).max(1e-6) - 2.0).max(0.0);
    writeln!(out, "Ns {exponent}")?;
    // A refractive index is one number; a coloured dielectric has only its Ks to say so.
    let is_grey = specular.x == specular.y && specular.y == specular.z;
    if is_grey || metallic > 0.0 {
        let f0 = f64::from(specular.element_sum()) / 3.0;
        let root = f0.clamp(0.0, 0.999).sqrt();
        writeln!(out, "Ni {}", ((1.0 + root) / (1.0 - root)) as f32)?;
        writeln!(out, "Pr {roughness}")?;
        writeln!(out, "Pm {metallic}")?;
    }
    writeln!(out, "illum 2")
}

fn write_color(out: &mut impl Write, key: &str, color: Vec3) -> io::Result<()> {
    writeln!(out, "{key} {} {} {}", color.x, color.y, color.z)
}
