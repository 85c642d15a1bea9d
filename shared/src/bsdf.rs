//! Reflection: Lambert under GGX with Schlick's Fresnel term, the metallic-roughness model of glTF 2.0
//! (appendix B), with the height-correlated Smith term. As that appendix says of its simple mix of the two layers,
//! a dielectric seen at a grazing angle can reflect more than it receives; a metal never does.

use core::f32::consts::{FRAC_1_PI, PI, TAU};
use glam::Vec3;

use crate::{
    numerics::{copysign, max, safe_sqrt, sin_cos, sqrt},
    surface::Surface,
};

/// Smallest alpha: a mirror would be a delta function, which no light sample can hit.
const MIN_ALPHA: f32 = 1e-3;

/// A surface unpacked for one view direction.
#[derive(Clone, Copy)]
pub struct Bsdf {
    /// Geometric normal on the viewer's side.
    pub normal_geometric: Vec3,
    /// Shading normal on the viewer's side.
    pub normal: Vec3,
    /// From the surface to the viewer, of length 1.
    pub outgoing: Vec3,
    diffuse: Vec3,
    specular: Vec3,
    alpha: f32,
}

impl Bsdf {
    /// The reflection of `surface` toward `outgoing` (of length 1).
    #[inline(always)]
    pub fn new(surface: &Surface, outgoing: Vec3) -> Self {
        let roughness = surface.roughness();
        Self {
            normal_geometric: surface.normal_geometric(),
            normal: surface.normal_shading(),
            outgoing,
            diffuse: surface.diffuse(),
            specular: surface.specular(),
            alpha: max(roughness * roughness, MIN_ALPHA),
        }
    }

    /// The BSDF times the cosine at the surface, in sr^-1, for light from `incoming` (of length 1). Zero for light
    /// from behind the geometric or the shading normal. `SPECULAR`: the scene has specular surfaces. Of a metal, within 18 ulp.
    #[inline(always)]
    pub fn evaluate<const SPECULAR: bool>(&self, incoming: Vec3) -> Vec3 {
        let cosine = self.normal.dot(incoming);
        if !(cosine > 0.0) || !(self.normal_geometric.dot(incoming) > 0.0) {
            return Vec3::ZERO;
        }
        if !SPECULAR || !self.has_specular() {
            return self.diffuse * (FRAC_1_PI * cosine);
        }
        let half = self.outgoing + incoming;
        let half = half * (1.0 / max(sqrt(half.length_squared()), 1e-20));
        let view_cosine = max(self.normal.dot(self.outgoing), 1e-4);
        let fresnel = self.fresnel(max(half.dot(incoming), 0.0));
        let lobe = ggx_density(self.alpha, self.normal, half) * smith_visibility(self.alpha, view_cosine, cosine);
        ((Vec3::ONE - fresnel) * self.diffuse * FRAC_1_PI + fresnel * lobe) * cosine
    }

    /// Whether there is a specular lobe at all. Without one there is no Fresnel loss at grazing angles either.
    #[inline(always)]
    pub fn has_specular(&self) -> bool {
        self.specular.x > 0.0 || self.specular.y > 0.0 || self.specular.z > 0.0
    }

    #[inline(always)]
    fn fresnel(&self, cosine: f32) -> Vec3 {
        // A cosine of rounded directions may be a little above 1.
        let c = max(1.0 - cosine, 0.0);
        let c2 = c * c;
        self.specular + (Vec3::ONE - self.specular) * (c2 * c2 * c)
    }

    /// Probability of drawing from the specular lobe, by a rough estimate of its share of the reflection.
    #[inline(always)]
    fn specular_share(&self) -> f32 {
        if !self.has_specular() {
            return 0.0;
        }
        let mean = |v: Vec3| (v.x + v.y + v.z) * (1.0 / 3.0);
        let specular = mean(self.fresnel(max(self.normal.dot(self.outgoing), 0.0)));
        let diffuse = mean(self.diffuse);
        // A floor on both, so that neither lobe is starved.
        let share = specular / max(specular + diffuse, 1e-20);
        0.1 + 0.8 * share
    }

    /// A direction drawn about in proportion to the BSDF, from three uniform numbers in 0..1; of length 1.
    #[inline(always)]
    pub fn sample(&self, choice: f32, u: f32, v: f32) -> Vec3 {
        let (tangent, bitangent) = basis(self.normal);
        if choice < self.specular_share() {
            let local = Vec3::new(
                self.outgoing.dot(tangent),
                self.outgoing.dot(bitangent),
                max(self.outgoing.dot(self.normal), 1e-4),
            );
            let half = sample_visible_normal(local, self.alpha, u, v);
            let half = tangent * half.x + bitangent * half.y + self.normal * half.z;
            half * (2.0 * self.outgoing.dot(half)) - self.outgoing
        } else {
            let (sine, cosine) = sin_cos(TAU * u);
            let radius = sqrt(v);
            tangent * (radius * cosine) + bitangent * (radius * sine) + self.normal * safe_sqrt(1.0 - v)
        }
    }

    /// Density of [`Bsdf::sample`] with respect to solid angle, in sr^-1. Of a metal, within 18 ulp.
    #[inline(always)]
    pub fn pdf_solid_angle(&self, incoming: Vec3) -> f32 {
        let cosine = self.normal.dot(incoming);
        let share = self.specular_share();
        let diffuse = max(cosine, 0.0) * FRAC_1_PI;
        if share <= 0.0 {
            return diffuse;
        }
        let half = self.outgoing + incoming;
        let half = half * (1.0 / max(sqrt(half.length_squared()), 1e-20));
        if !(self.normal.dot(half) > 0.0) {
            return diffuse * (1.0 - share);
        }
        // Density of visible normals / (4 o.h), in which o.h cancels: D G1 / (4 o.n).
        let view_cosine = max(self.normal.dot(self.outgoing), 1e-4);
        let a2 = self.alpha * self.alpha;
        let masking = 2.0 / (view_cosine + sqrt(a2 + (1.0 - a2) * view_cosine * view_cosine));
        let specular = ggx_density(self.alpha, self.normal, half) * masking * 0.25;
        diffuse * (1.0 - share) + specular * share
    }
}

/// GGX distribution of normals, per steradian of half vectors.
#[inline(always)]
fn ggx_density(alpha: f32, normal: Vec3, half: Vec3) -> f32 {
    let cosine = max(normal.dot(half), 0.0);
    // The sine from the cross product: 1 - cosine^2 would leave no digits for small alpha.
    let sine2 = normal.cross(half).length_squared();
    let a2 = alpha * alpha;
    let d = sine2 + a2 * cosine * cosine;
    a2 / (PI * d * d)
}

/// Smith's masking and shadowing, height-correlated, divided by 4 n.l n.v. Source: Heitz 2014, equation 99.
#[inline(always)]
fn smith_visibility(alpha: f32, view_cosine: f32, light_cosine: f32) -> f32 {
    let a2 = alpha * alpha;
    let view = light_cosine * sqrt(a2 + (1.0 - a2) * view_cosine * view_cosine);
    let light = view_cosine * sqrt(a2 + (1.0 - a2) * light_cosine * light_cosine);
    0.5 / max(view + light, 1e-20)
}

/// A normal visible from `view` (local, z up). Source: Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with
/// Spherical Caps".
#[inline(always)]
fn sample_visible_normal(view: Vec3, alpha: f32, u: f32, v: f32) -> Vec3 {
    let stretched = Vec3::new(view.x * alpha, view.y * alpha, view.z);
    let stretched = stretched * (1.0 / sqrt(stretched.length_squared()));
    let (sine, cosine) = sin_cos(TAU * u);
    let z = (1.0 - v) * (1.0 + stretched.z) - stretched.z;
    let radius = safe_sqrt(1.0 - z * z);
    let half = Vec3::new(radius * cosine, radius * sine, z) + stretched;
    let normal = Vec3::new(half.x * alpha, half.y * alpha, max(half.z, 1e-12));
    normal * (1.0 / sqrt(normal.length_squared()))
}

/// Two directions that complete a unit vector to a right-handed orthonormal basis.
///
/// Source: Duff et al. 2017, "Building an Orthonormal Basis, Revisited".
#[inline(always)]
pub fn basis(n: Vec3) -> (Vec3, Vec3) {
    let sign = copysign(1.0, n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        numerics::{pack_unorm16, unit_float},
        octahedral,
        rng::pcg4d,
    };

    fn surface(diffuse: f32, specular: f32, roughness: f32) -> Surface {
        Surface {
            normal_geometric: octahedral::pack(Vec3::Z),
            normal_shading: octahedral::pack(Vec3::Z),
            specular_rg: pack_unorm16(specular) * 0x1_0001,
            specular_b_roughness: pack_unorm16(specular) | (pack_unorm16(roughness) << 16),
            diffuse: [diffuse; 3],
            instance: 0x8000_0000,
            ..Surface::default()
        }
    }

    fn is_unit(n: Vec3) -> bool {
        (n.length_squared() - 1.0).abs() < 1e-4
    }

    fn numbers(i: u32) -> (f32, f32, f32) {
        let [a, b, c, _] = pcg4d(i, 77, 1, 2);
        (unit_float(a), unit_float(b), unit_float(c))
    }

    /// Views from overhead to grazing.
    fn views() -> impl Iterator<Item = Vec3> {
        [0.05f32, 0.3, 0.7, 1.0].into_iter().map(|z| Vec3::new((1.0 - z * z).sqrt(), 0.0, z))
    }

    #[test]
    fn nothing_is_reflected_less_than_not_at_all() {
        let surface = Surface { normal_shading: octahedral::pack(Vec3::Z), ..Surface::default() };
        let bsdf = Bsdf::new(&surface, Vec3::Z);
        for cosine in [0.0, 1.0, 1.0 + f32::EPSILON, 1.000_001] {
            assert!(bsdf.fresnel(cosine).min_element() >= 0.0, "{cosine}");
        }
    }

    #[test]
    fn a_basis_is_orthonormal_everywhere_negative_zero_and_the_pole_included() {
        for n in [Vec3::Z, -Vec3::Z, Vec3::X, Vec3::new(0.6, -0.8, -0.0), Vec3::new(1e-4, 0.0, -1.0 + 1e-7)] {
            let (t, b) = basis(n);
            assert!(is_unit(t) && is_unit(b), "{n}");
            assert!(t.dot(b).abs() < 1e-6 && t.dot(n).abs() < 1e-6 && b.dot(n).abs() < 1e-6, "{n}");
            assert!((t.cross(b) - n).length() < 1e-5, "{n}");
        }
    }

    #[test]
    fn a_white_lambertian_surface_reflects_all_light() {
        let bsdf = Bsdf::new(&surface(1.0, 0.0, 1.0), Vec3::Z);
        let n = 200_000;
        let mut sum = 0.0;
        for i in 0..n {
            let (_, u, v) = numbers(i);
            let (s, c) = sin_cos(TAU * u);
            let radius = safe_sqrt(1.0 - v * v);
            sum += f64::from(bsdf.evaluate::<true>(Vec3::new(radius * c, radius * s, v)).x) * core::f64::consts::TAU;
        }
        assert!((sum / f64::from(n) - 1.0).abs() < 0.005);
    }

    #[test]
    fn no_metal_reflects_more_than_it_receives() {
        for roughness in [0.05, 0.2, 0.5, 1.0] {
            for (diffuse, specular) in [(0.0, 1.0), (0.0, 0.04)] {
                for view in views() {
                    let bsdf = Bsdf::new(&surface(diffuse, specular, roughness), view);
                    let n = 100_000;
                    let (mut sum, mut squares) = (0.0, 0.0);
                    for i in 0..n {
                        let (w, u, v) = numbers(i);
                        let incoming = bsdf.sample(w, u, v);
                        let pdf = bsdf.pdf_solid_angle(incoming);
                        if pdf > 0.0 {
                            let x = f64::from(bsdf.evaluate::<true>(incoming).x / pdf);
                            sum += x;
                            squares += x * x;
                        }
                    }
                    let mean = sum / f64::from(n);
                    let error = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
                    assert!(mean < 1.0 + 5.0 * error + 1e-3, "{roughness} {diffuse} {specular} {view}: {mean}");
                }
            }
        }
    }

    /// Pearson's test on a grid over the sphere: samples against the density they claim.
    #[test]
    fn sampled_directions_follow_their_density() {
        const ROWS: usize = 12;
        const COLUMNS: usize = 16;
        const SAMPLES: u32 = 400_000;
        const FINE: usize = 24;
        for (roughness, view) in [0.3, 0.6, 1.0].into_iter().flat_map(|r| views().map(move |v| (r, v))) {
            if roughness < 0.5 && view.z < 0.2 {
                // A wedge a hundredth of a radian wide: the quadrature below cannot resolve it, that of `lobe_statistic` can.
                continue;
            }
            let bsdf = Bsdf::new(&surface(0.5, 0.3, roughness), view);
            let mut observed = [0.0f64; 12 * 16];
            for i in 0..SAMPLES {
                let (w, u, v) = numbers(i);
                let d = bsdf.sample(w, u, v);
                let row = ((d.z * 0.5 + 0.5) * ROWS as f32).clamp(0.0, ROWS as f32 - 0.5) as usize;
                let angle = d.y.atan2(d.x) / core::f32::consts::TAU;
                let column = ((angle - angle.floor()) * COLUMNS as f32) as usize % COLUMNS;
                observed[row * COLUMNS + column] += 1.0;
            }
            let (mut statistic, mut cells, mut pooled) = (0.0, 0, (0.0, 0.0));
            for row in 0..ROWS {
                for column in 0..COLUMNS {
                    let mut expected = 0.0f64;
                    for i in 0..FINE * FINE {
                        let x = (column as f32 + ((i % FINE) as f32 + 0.5) / FINE as f32) / COLUMNS as f32;
                        let z = 2.0 * (row as f32 + ((i / FINE) as f32 + 0.5) / FINE as f32) / ROWS as f32 - 1.0;
                        let r = (1.0 - z * z).sqrt();
                        let d = Vec3::new(r * (x * TAU).cos(), r * (x * TAU).sin(), z);
                        expected += f64::from(bsdf.pdf_solid_angle(d));
                    }
                    let solid_angle = 2.0 * core::f64::consts::TAU / (ROWS * COLUMNS) as f64;
                    expected *= solid_angle / (FINE * FINE) as f64 * f64::from(SAMPLES);
                    let seen = observed[row * COLUMNS + column];
                    if expected < 20.0 {
                        pooled = (pooled.0 + expected, pooled.1 + seen);
                    } else {
                        statistic += (seen - expected).powi(2) / expected;
                        cells += 1;
                    }
                }
            }
            assert!((pooled.0 - pooled.1).abs() < 6.0 * f64::sqrt(pooled.0.max(pooled.1)) + 10.0, "{pooled:?}");
            // The statistic has mean `cells` and variance 2 `cells`; the quadrature adds a little.
            let bound = f64::from(cells) + 6.0 * (2.0 * f64::from(cells)).sqrt();
            assert!(statistic < bound, "roughness {roughness}, view {view}: {statistic} over {cells} cells");
        }
    }

    /// Pearson's test in coordinates in which the specular lobe is of one size for every roughness and view: the slope of
    /// the normal between the two directions over alpha. Those far from the lobe count as one.
    ///
    /// `wrong` multiplies the density on one side. The statistic, and how many cells there were.
    fn lobe_statistic(roughness: f32, view: Vec3, wrong: f64) -> (f64, f64) {
        const ROWS: usize = 12;
        const COLUMNS: usize = 16;
        const SAMPLES: u32 = 300_000;
        const FINE: usize = 12;
        // Share of the normals of a GGX lobe within the slope s alpha: s^2 / (1 + s^2).
        const WITHIN: f64 = 0.95;
        let bsdf = Bsdf::new(&surface(0.2, 0.6, roughness), view);
        let alpha = f64::from(bsdf.alpha);
        let outgoing = view.as_dvec3();
        let mut observed = [0.0f64; ROWS * COLUMNS + 1];
        for i in 0..SAMPLES {
            let (w, u, v) = numbers(i);
            let half = outgoing + bsdf.sample(w, u, v).as_dvec3();
            let slope = half.truncate() / (half.z * alpha);
            let share = slope.length_squared() / (1.0 + slope.length_squared()) / WITHIN;
            let angle = slope.y.atan2(slope.x) / core::f64::consts::TAU;
            let column = ((angle - angle.floor()) * COLUMNS as f64) as usize % COLUMNS;
            let is_within = half.z > 0.0 && share < 1.0;
            observed[if is_within { (share * ROWS as f64) as usize * COLUMNS + column } else { ROWS * COLUMNS }] += 1.0;
        }
        let mut expected = [0.0f64; ROWS * COLUMNS + 1];
        for row in 0..ROWS * FINE {
            for column in 0..COLUMNS * FINE {
                let share = (row as f64 + 0.5) / (ROWS * FINE) as f64 * WITHIN;
                let angle = (column as f64 + 0.5) / (COLUMNS * FINE) as f64 * core::f64::consts::TAU;
                let slope2 = share / (1.0 - share);
                let tangent = alpha * slope2.sqrt();
                let half = glam::DVec3::new(tangent * angle.cos(), tangent * angle.sin(), 1.0).normalize();
                let along = outgoing.dot(half);
                if along > 0.0 {
                    let incoming = half * (2.0 * along) - outgoing;
                    let pdf = f64::from(bsdf.pdf_solid_angle(incoming.as_vec3()));
                    // d incoming / d half, d half / d slope, d slope / d (share, angle).
                    let jacobian = 4.0 * along * alpha * alpha * half.z.powi(3) * 0.5 * (1.0 + slope2).powi(2);
                    let size = WITHIN * core::f64::consts::TAU / (ROWS * FINE * COLUMNS * FINE) as f64;
                    let factor = if angle < 1.0 { wrong } else { 1.0 };
                    expected[row / FINE * COLUMNS + column / FINE] +=
                        factor * pdf * jacobian * size * f64::from(SAMPLES);
                }
            }
        }
        let within: f64 = expected.iter().sum();
        expected[ROWS * COLUMNS] = f64::from(SAMPLES) - within;
        let (mut statistic, mut cells, mut rest) = (0.0, 0.0, (0.0, 0.0));
        for (seen, expected) in observed.into_iter().zip(expected) {
            if expected < 20.0 {
                rest = (rest.0 + expected, rest.1 + seen);
            } else {
                statistic += (seen - expected).powi(2) / expected;
                cells += 1.0;
            }
        }
        assert!((rest.0 - rest.1).abs() < 6.0 * f64::sqrt(rest.0.max(rest.1)) + 10.0, "{rest:?}");
        (statistic, cells)
    }

    #[test]
    fn sampled_directions_follow_their_density_on_smooth_surfaces_and_at_grazing_angles() {
        for roughness in [0.0, 0.05, 0.1, 0.2, 0.3, 0.6, 1.0] {
            for z in [0.01f32, 0.05, 0.2, 0.7, 1.0] {
                let view = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
                let (statistic, cells) = lobe_statistic(roughness, view, 1.0);
                let bound = |cells: f64| cells + 6.0 * (2.0 * cells).sqrt();
                println!("{roughness} {z}: {statistic:.0} over {cells}");
                assert!(statistic < bound(cells), "roughness {roughness}, view {view}: {statistic} over {cells} cells");
            }
        }
        // Teeth.
        let (statistic, cells) = lobe_statistic(0.1, Vec3::new(0.6, 0.0, 0.8), 1.1);
        assert!(statistic > cells + 6.0 * (2.0 * cells).sqrt(), "10 % are not seen: {statistic} over {cells} cells");
    }
}
