//! From the statements of a material library to the material model of this renderer.

use glam::Vec3;

use super::Material;
use super::error::Warnings;
use super::mtl::MtlMaterial;

/// Reflectance at normal incidence where the library does not give an index of refraction.
const DEFAULT_F0: f32 = 0.04;

/// A material whose textures are still names.
#[derive(Clone, Debug, Default)]
pub struct Unbound {
    /// Everything but the textures.
    pub material: Material,
    /// File name of `map_Kd`.
    pub base_color_map: Option<String>,
    /// File name of `map_Ke`.
    pub emission_map: Option<String>,
    /// File name of `map_d`.
    pub alpha_map: Option<String>,
    /// `d 0`: nothing of it is to be seen.
    pub invisible: bool,
}

/// Interprets `mtl`; with `lambert`, as a Lambertian surface of albedo `Kd`.
///
/// - With `Pr` or `Pm`: metallic-roughness, with the dielectric's reflectance from `Ni`. A metal that keeps its colour
///   in `Ks`, with a black `Kd`, has it as base colour.
/// - Else, with a `Ks` and a model that has highlights: `Ks` is the reflectance at normal incidence, and
///   alpha = sqrt(2 / (`Ns` + 2)), the GGX lobe about as wide as the Phong one.
///   Source: Walter et al. 2007, section 5.2.
/// - Else: Lambert.
pub fn interpret(mtl: &MtlMaterial, lambert: bool, warnings: &mut Warnings) -> Unbound {
    let statements = &mtl.statements;
    let name = statements.name.clone();
    let color = |color: Option<[f32; 3]>| color.map(Vec3::from_array);
    let mut warn = |message: String| warnings.push(mtl.place.clone(), message);

    let base_color_map = statements.diffuse_texture.clone();
    let alpha_map = statements.dissolve_texture.clone();
    let mut emission_map = statements.unknown_param.get("map_Ke").cloned();

    let unset = if base_color_map.is_some() { Vec3::ONE } else { Material::default().base_color };
    let mut base_color = color(statements.diffuse).unwrap_or(unset);
    let emission = color(statements.emissive).unwrap_or(if emission_map.is_some() { Vec3::ONE } else { Vec3::ZERO });
    if emission == Vec3::ZERO && emission_map.take().is_some() {
        warn(format!("`map_Ke` of material `{name}` has no effect, because its `Ke` is black"));
    }
    let ambient = color(statements.ambient).unwrap_or(Vec3::ZERO);
    if ambient.max_element() > 1.0 && emission == Vec3::ZERO {
        warn(format!("`Ka` of material `{name}` is ignored; use `Ke` for emission"));
    }

    let model = statements.illumination_model;
    let glass = matches!(model, Some(4 | 6 | 7 | 9));
    let transparency = mtl.number("Tr").map(|transparency| 1.0 - transparency);
    let opacity = statements.dissolve.or(transparency).filter(|_| alpha_map.is_none()).unwrap_or(1.0);
    // Exporters write `d 0` for glass, which is anything but invisible.
    let invisible = opacity == 0.0 && !glass;
    if invisible {
        warn(format!("material `{name}` is fully transparent (`d 0`): its triangles are dropped"));
    } else if let (Some(model), true) = (model, glass) {
        warn(format!("material `{name}` (`illum {model}`) is drawn opaque: refraction is not supported"));
    } else if opacity < 1.0 {
        warn(format!("material `{name}` (`d {opacity}`) is drawn opaque: only masks (`map_d`) are supported"));
    }
    let (roughness, metallic) = (mtl.number("Pr"), mtl.number("Pm"));
    let phong = color(statements.specular).filter(|_| !matches!(model, Some(0 | 1))).unwrap_or(Vec3::ZERO);
    let f0 = Vec3::splat(reflectance(statements.optical_density));
    let (specular, roughness, metallic) = if lambert {
        (Vec3::ZERO, 1.0, 0.0)
    } else if roughness.is_some() || metallic.is_some() {
        let metallic = metallic.unwrap_or(0.0);
        let black = base_color == Vec3::ZERO && base_color_map.is_none();
        if metallic > 0.0 && black {
            base_color = color(statements.specular).unwrap_or(base_color);
        }
        (f0, roughness.unwrap_or(phong_roughness(statements.shininess)), metallic)
    } else if phong != Vec3::ZERO {
        (phong, phong_roughness(statements.shininess), 0.0)
    } else if glass {
        (f0, phong_roughness(statements.shininess), 0.0)
    } else {
        (Vec3::ZERO, 1.0, 0.0)
    };
    let material = Material { name, base_color, specular, roughness, metallic, emission, ..Material::default() };
    Unbound { material, base_color_map, emission_map, alpha_map, invisible }
}

/// Reflectance at normal incidence of a dielectric in air.
fn reflectance(index_of_refraction: Option<f32>) -> f32 {
    match index_of_refraction {
        Some(index) if index > 1.0 => ((index - 1.0) / (index + 1.0)).powi(2),
        _ => DEFAULT_F0,
    }
}

/// Perceptual roughness, the square root of alpha, for a Phong exponent.
fn phong_roughness(exponent: Option<f32>) -> f32 {
    (2.0 / (exponent.unwrap_or(0.0) + 2.0)).sqrt().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::mtl;

    fn material(statements: &str, lambert: bool) -> (Unbound, Vec<String>) {
        let mut warnings = Warnings::default();
        let text = format!("newmtl m\n{statements}");
        let materials = mtl::read(text.as_bytes(), "t.mtl", u64::MAX, &mut warnings);
        let unbound = interpret(&materials[0], lambert, &mut warnings);
        (unbound, warnings.into_vec().iter().map(ToString::to_string).collect())
    }

    fn close(a: Vec3, b: Vec3) -> bool {
        a.abs_diff_eq(b, 1e-6)
    }

    #[test]
    fn roughness_and_metallic_win_over_phong() {
        let (unbound, warnings) = material("Kd 0.2 0.3 0.4\nKs 1 1 1\nNs 19\nNi 1.5\nPr 0.25\nPm 0.5", false);
        let material = unbound.material;
        assert_eq!((material.roughness, material.metallic), (0.25, 0.5));
        assert!(close(material.specular, Vec3::splat(0.04)), "{}", material.specular);
        assert_eq!(material.base_color, Vec3::new(0.2, 0.3, 0.4));
        assert_eq!(warnings, Vec::<String>::new());
    }

    #[test]
    fn the_reflectance_of_a_dielectric_follows_its_index() {
        assert!((reflectance(Some(2.0)) - 1.0 / 9.0).abs() < 1e-6);
        assert_eq!(reflectance(Some(1.0)), DEFAULT_F0);
        assert_eq!(reflectance(None), DEFAULT_F0);
    }

    #[test]
    fn a_metal_with_its_colour_in_ks_keeps_it() {
        let metal = "Kd 0 0 0\nKs 0.9 0.6 0.3\nPr 0.1\nPm 1";
        assert_eq!(material(metal, false).0.material.base_color, Vec3::new(0.9, 0.6, 0.3));
        assert_eq!(material(metal, true).0.material.base_color, Vec3::ZERO);
    }

    #[test]
    fn phong_highlights_become_roughness() {
        let material = material("Kd 0.5\nKs 0.3\nNs 798\nillum 2", false).0.material;
        assert_eq!(material.specular, Vec3::splat(0.3));
        assert!((material.roughness - 0.223_607).abs() < 1e-6, "{}", material.roughness);
    }

    #[test]
    fn without_highlights_a_material_is_lambertian() {
        for statements in ["Kd 1\nKs 0 0 0\nNs 10", "Kd 1\nKs 1 1 1\nillum 1", "Kd 1"] {
            assert_eq!(material(statements, false).0.material.specular, Vec3::ZERO, "{statements}");
        }
        let material = material("Kd 0.5\nKs 1\nPr 0.1\nPm 1\nillum 7", true);
        assert_eq!((material.0.material.specular, material.0.material.metallic), (Vec3::ZERO, 0.0));
        assert_eq!(material.1.len(), 1, "glass: {:?}", material.1);
    }

    #[test]
    fn transparency_is_opaque_or_absent_and_says_so() {
        let (unbound, warnings) = material("d 0.5", false);
        assert!(!unbound.invisible && warnings[0].contains("`m` (`d 0.5`) is drawn opaque"), "{warnings:?}");
        let (unbound, warnings) = material("Tr 1", false);
        assert!(unbound.invisible && warnings[0].contains("its triangles are dropped"), "{warnings:?}");
        let (unbound, warnings) = material("d 0\nmap_d leaf.png", false);
        assert!(!unbound.invisible && warnings.is_empty(), "{warnings:?}");
        // When both are given, `d` is what its writer meant: some write `Tr` with the opposite sense.
        assert!(!material("d 1\nTr 1", false).0.invisible);
    }

    #[test]
    fn emission_comes_from_ke_alone() {
        assert_eq!(material("map_Ke e.png", false).0.material.emission, Vec3::ONE);
        let (unbound, warnings) = material("Ka 20 20 20", false);
        assert_eq!(unbound.material.emission, Vec3::ZERO);
        assert_eq!(warnings, ["t.mtl:1: `Ka` of material `m` is ignored; use `Ke` for emission"]);
        let (unbound, warnings) = material("Ke 0 0 0\nmap_Ke e.png", false);
        assert!(unbound.emission_map.is_none() && warnings.len() == 1, "{warnings:?}");
    }

    #[test]
    fn glass_is_an_opaque_dielectric() {
        let (unbound, warnings) = material("Kd 0\nNi 1.5\nNs 1000\nd 0\nillum 7", false);
        assert!(!unbound.invisible);
        assert!(close(unbound.material.specular, Vec3::splat(0.04)));
        assert!(warnings[0].ends_with("refraction is not supported"), "{warnings:?}");
    }
}
