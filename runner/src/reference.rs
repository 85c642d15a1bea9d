//! The reference: a plain path tracer, apart from the passes, that everything else is judged by.
//!
//! Emissive triangles are drawn uniformly, the environment by its own cumulative table, directions by the BSDF; the two
//! ways to find a light are combined by the balance heuristic (Veach and Guibas 1995). Of shapes and of directional
//! lights, which no direction finds, one each is drawn uniformly for every surface; a sphere by the directions to it. Sums
//! are in f64 and random numbers come from a generator that no pass uses. What it shares with the passes is geometry,
//! materials and the BSDF.

use glam::{DMat4, DVec3, DVec4, UVec4, Vec3};
use rand_pcg::{
    Pcg64Mcg,
    rand_core::{Rng, SeedableRng},
};
use rayon::prelude::*;
use weir_shared::{
    bsdf::Bsdf,
    bvh,
    camera::ray_through,
    environment,
    frame::Frame,
    light,
    ray::{FAR, Hit, Ray, offset_origin},
    scene::{
        NO_TEXTURE, Scene as SceneView, attribute_flags, distant_record, emitter_record, instance_record,
        material_record, shape,
    },
    surface::{Surface, surface_at},
    texture,
};

use crate::{margin::PixelMoments, packed::PackedScene};

/// Mean and variance of a pixel in double precision.
#[derive(Clone, Copy, Debug, Default)]
pub struct Estimate {
    /// Mean radiance, linear Rec. 709.
    pub mean: DVec3,
    /// Sum of squared deviations.
    deviation: DVec3,
    /// Samples.
    pub count: u64,
    /// Samples among them that were not finite and count as black.
    pub dropped: u64,
}

impl Estimate {
    fn add(&mut self, value: DVec3) {
        self.count += 1;
        let difference = value - self.mean;
        self.mean += difference / self.count as f64;
        self.deviation += difference * (value - self.mean);
    }

    /// Mean and squared deviations.
    pub fn moments(&self) -> PixelMoments {
        PixelMoments { mean: self.mean.to_array(), deviation: self.deviation.to_array() }
    }

    /// Variance of the mean; zero before the second sample.
    pub fn variance_of_mean(&self) -> DVec3 {
        let n = self.count as f64;
        if self.count < 2 { DVec3::ZERO } else { self.deviation / (n * (n - 1.0)) }
    }
}

/// The reference integrator for one scene and view.
pub struct Reference<'a> {
    frame: Frame,
    scene: SceneView<'a>,
    bvh: &'a [UVec4],
    environment: Option<EnvironmentTable>,
    shapes: Vec<Shape>,
    /// Directions toward directional lights, and their irradiance.
    distant: Vec<(DVec3, DVec3)>,
    masks: bool,
    instances: bool,
    /// Surfaces on a path: 1 is direct light.
    path_length: u32,
}

/// A light of a shape in closed form.
struct Shape {
    /// Its id.
    light: u32,
    kind: u32,
    world_from_object: DMat4,
    /// Radiance, or radiant intensity.
    emission: DVec3,
    two_sided: bool,
    mirrored: bool,
    /// Of a spot: cosines where its falloff ends and where it begins, outermost first.
    cosines: [f64; 2],
}

impl Shape {
    /// Those of all emitters.
    fn all(frame: &Frame, scene: &SceneView<'_>) -> Vec<Self> {
        let instances = (0..frame.emitter_count).map(|e| {
            let word = |field| scene.emitter_word(frame, e, field);
            (word(emitter_record::INSTANCE), word(emitter_record::FIRST_LIGHT))
        });
        instances.filter_map(|(instance, light)| Self::new(frame, scene, instance, light)).collect()
    }

    fn new(frame: &Frame, scene: &SceneView<'_>, instance: u32, light: u32) -> Option<Self> {
        let word = |field| scene.instance_word(frame, instance, field);
        let flags = word(instance_record::FLAGS);
        let kind = flags >> attribute_flags::SHAPE_SHIFT;
        if kind == shape::TRIANGLES || kind == shape::UNSEEN {
            return None;
        }
        let float = |at: u32| f64::from(f32::from_bits(scene.record(at)));
        let matrix = scene.instance_at(frame, instance) + instance_record::WORLD_FROM_OBJECT;
        let row = |i: u32| DVec4::from_array([0, 1, 2, 3].map(|j| float(matrix + 4 * i + j)));
        let attributes = word(instance_record::ATTRIBUTES_AT);
        let material = scene.material_of(frame, instance, word(instance_record::FIRST_TRIANGLE));
        let (scale, offset) = (float(attributes + shape::FALLOFF_SCALE), float(attributes + shape::FALLOFF_OFFSET));
        Some(Self {
            light,
            kind,
            world_from_object: DMat4::from_cols(row(0), row(1), row(2), DVec4::W).transpose(),
            emission: scene.emission(frame, instance, material).as_dvec3(),
            two_sided: scene.material_word(material, material_record::TWO_SIDED) != 0,
            mirrored: flags & attribute_flags::MIRRORED != 0,
            // A point has them below all cosines.
            cosines: if scale > 0.0 { [-offset / scale, (1.0 - offset) / scale] } else { [-3.0, -2.0] },
        })
    }

    /// A point that shines to `position`, where one end of a shadow ray is, and what arrives from there: irradiance on a
    /// surface that faces it, over the density of the choice.
    fn sample(&self, position: DVec3, rng: &mut Pcg64Mcg) -> Option<(DVec3, DVec3)> {
        let center = self.world_from_object.w_axis.truncate();
        let (first, second) = (uniform(rng), uniform(rng));
        let (point, solid_angle) = match self.kind {
            shape::PUNCTUAL => {
                let away = position - center;
                let axis = self.world_from_object.transform_vector3(DVec3::NEG_Z).normalize();
                let [outer, inner] = self.cosines;
                let falloff = ((axis.dot(away.normalize()) - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2);
                (center, falloff / away.length_squared())
            }
            shape::SPHERE => {
                // Uniform over the cone of directions to it. Source: Shirley et al. 1996.
                let radius2 = self.world_from_object.determinant().abs().powf(2.0 / 3.0);
                let toward = center - position;
                let distance2 = toward.length_squared();
                if distance2 <= radius2 {
                    return None;
                }
                // One less the cosine of the half angle, also where that is small.
                let sin2 = radius2 / distance2;
                let opening = sin2 / (1.0 + (1.0 - sin2).sqrt());
                let below = first * opening;
                let across = (below * (2.0 - below)).max(0.0).sqrt();
                let (x, y) = toward.normalize().any_orthonormal_pair();
                let (sin, cos) = (second * core::f64::consts::TAU).sin_cos();
                let direction = toward.normalize() * (1.0 - below) + (x * cos + y * sin) * across;
                let along = direction.dot(toward);
                let to_edge = (radius2 - distance2 + along * along).max(0.0).sqrt();
                (position + direction * (along - to_edge), core::f64::consts::TAU * opening)
            }
            _ => {
                let (x, y) = (self.world_from_object.x_axis.truncate(), self.world_from_object.y_axis.truncate());
                let point = center + x * (2.0 * first - 1.0) + y * (2.0 * second - 1.0);
                let front = x.cross(y) * (if self.mirrored { -4.0 } else { 4.0 });
                let away = position - point;
                let facing = front.dot(away);
                let facing = if self.two_sided { facing.abs() } else { facing.max(0.0) };
                (point, facing / away.length().powi(3))
            }
        };
        (solid_angle > 0.0).then_some((point, self.emission * solid_angle))
    }
}

fn distant_lights(frame: &Frame, scene: &SceneView<'_>) -> Vec<(DVec3, DVec3)> {
    let starts = (frame.distant_at..frame.materials_at).step_by(distant_record::WORDS as usize);
    let vector = |at: u32| scene.record_vector(at).as_dvec3();
    starts.map(|at| (vector(at + distant_record::DIRECTION), vector(at + distant_record::IRRADIANCE))).collect()
}

/// Cumulative weights over the texels of the environment.
struct EnvironmentTable {
    cumulative: Vec<f64>,
}

impl EnvironmentTable {
    fn new(frame: &Frame, scene: &SceneView<'_>) -> Option<Self> {
        let (width, height) = (i64::from(frame.environment_width), i64::from(frame.environment_height));
        if width == 0 {
            return None;
        }
        let value = |x: i64, y: i64| {
            let texel = y.clamp(0, height - 1) * width + x.rem_euclid(width);
            let at = frame.environment_texels_at as usize + texel as usize * 3;
            scene.texels[at..at + 3].iter().map(|&b| f64::from(f32::from_bits(b))).sum::<f64>()
        };
        let mut sum = 0.0;
        let mut cumulative = Vec::with_capacity((width * height) as usize);
        for y in 0..height {
            let solid_angle = texel_solid_angle(frame, y as usize);
            for x in 0..width {
                // The brightest neighbour: positive wherever the interpolation is.
                let neighbours = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
                let brightest = neighbours.map(|(x, y)| value(x, y)).fold(0.0, f64::max);
                sum += (0.9 * value(x, y) + 0.1 * brightest) * solid_angle;
                cumulative.push(sum);
            }
        }
        (sum > 0.0).then_some(Self { cumulative })
    }

    fn probability(&self, texel: usize) -> f64 {
        let before = if texel == 0 { 0.0 } else { self.cumulative[texel - 1] };
        (self.cumulative[texel] - before) / self.cumulative[self.cumulative.len() - 1]
    }

    fn draw(&self, u: f64) -> usize {
        let wanted = u * self.cumulative[self.cumulative.len() - 1];
        self.cumulative.partition_point(|&c| c <= wanted).min(self.cumulative.len() - 1)
    }
}

fn texel_solid_angle(frame: &Frame, row: usize) -> f64 {
    let theta = |row: usize| row as f64 / f64::from(frame.environment_height) * core::f64::consts::PI;
    (theta(row).cos() - theta(row + 1).cos()) * core::f64::consts::TAU / f64::from(frame.environment_width)
}

fn uniform(rng: &mut Pcg64Mcg) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// One of `all`, each with the same probability; draws nothing from `rng` if there is none.
fn one_of<'b, T>(all: &'b [T], rng: &mut Pcg64Mcg) -> Option<&'b T> {
    let last = all.len().checked_sub(1)?;
    all.get(((uniform(rng) * all.len() as f64) as usize).min(last))
}

impl<'a> Reference<'a> {
    /// The integrator for a packed scene seen as `frame` says. `path_length` counts the surfaces of a path.
    pub fn new(packed: &'a PackedScene, frame: Frame, path_length: u32) -> Self {
        let scene = SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels };
        Self {
            frame,
            scene,
            bvh: &packed.bvh,
            environment: EnvironmentTable::new(&frame, &scene),
            shapes: Shape::all(&frame, &scene),
            distant: distant_lights(&frame, &scene),
            masks: packed.content.masks,
            instances: packed.content.instances,
            path_length,
        }
    }

    /// Adds `samples` more to each pixel, from a stream of random numbers for this pixel and `block`.
    pub fn accumulate(&self, estimates: &mut [Estimate], block: u64, samples: u32) {
        let width = self.frame.width as usize;
        estimates.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, estimate) in row.iter_mut().enumerate() {
                let pixel = (y * width + x) as u64;
                let key = [pixel, block, u64::from(self.frame.seed), 0x7265_6665_7265_6e63];
                let mut seed = [0; 16];
                let mut mixed = 0u64;
                for (i, word) in key.into_iter().enumerate() {
                    // SplitMix64 (Steele et al. 2014) over the words of the key.
                    mixed = mixed.wrapping_add(word).wrapping_add(0x9e37_79b9_7f4a_7c15);
                    let z = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
                    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
                    mixed = z ^ (z >> 31);
                    seed[(i & 1) * 8..][..8].copy_from_slice(&mixed.to_le_bytes());
                }
                let mut rng = Pcg64Mcg::from_seed(seed);
                for _ in 0..samples {
                    let radiance = self.sample(x as f32, y as f32, &mut rng);
                    estimate.dropped += u64::from(!radiance.is_finite());
                    estimate.add(if radiance.is_finite() { radiance } else { DVec3::ZERO });
                }
            }
        });
    }

    fn closest(&self, ray: &Ray) -> Hit {
        let (frame, scene, bvh) = (&self.frame, &self.scene, self.bvh);
        match (self.masks, self.instances) {
            (false, false) => bvh::closest_hit::<false, false>(frame, scene, bvh, ray),
            (false, true) => bvh::closest_hit::<false, true>(frame, scene, bvh, ray),
            (true, false) => bvh::closest_hit::<true, false>(frame, scene, bvh, ray),
            (true, true) => bvh::closest_hit::<true, true>(frame, scene, bvh, ray),
        }
    }

    fn visible(&self, ray: &Ray) -> bool {
        let (frame, scene, bvh) = (&self.frame, &self.scene, self.bvh);
        match (self.masks, self.instances) {
            (false, false) => bvh::unoccluded::<false, false>(frame, scene, bvh, ray),
            (false, true) => bvh::unoccluded::<false, true>(frame, scene, bvh, ray),
            (true, false) => bvh::unoccluded::<true, false>(frame, scene, bvh, ray),
            (true, true) => bvh::unoccluded::<true, true>(frame, scene, bvh, ray),
        }
    }

    fn sky(&self, direction: Vec3) -> DVec3 {
        if self.environment.is_some() {
            environment::radiance(&self.frame, &self.scene, direction).as_dvec3()
        } else {
            DVec3::ZERO
        }
    }

    /// Radiance of one path through pixel (x, y).
    fn sample(&self, x: f32, y: f32, rng: &mut Pcg64Mcg) -> DVec3 {
        let (dx, dy) = if !self.frame.is_jittered() { (0.5, 0.5) } else { (uniform(rng) as f32, uniform(rng) as f32) };
        let mut ray = ray_through(&self.frame, x + dx, y + dy);
        let mut hit = self.closest(&ray);
        if hit.is_miss() {
            return self.sky(ray.direction);
        }
        let mut found = surface_at::<true>(&self.frame, &self.scene, &hit, ray.direction);
        let mut radiance = found.emitted.as_dvec3();
        let mut throughput = DVec3::ONE;
        for _ in 0..self.path_length {
            let surface = found.surface;
            let bsdf = Bsdf::new(&surface, -ray.direction);
            radiance += throughput * self.light_sample(&surface, &bsdf, rng);

            let direction = bsdf.sample(uniform(rng) as f32, uniform(rng) as f32, uniform(rng) as f32);
            let pdf = f64::from(bsdf.pdf_solid_angle(direction));
            let reflected = bsdf.evaluate::<true>(direction).as_dvec3();
            if pdf <= 0.0 || pdf.is_nan() || reflected == DVec3::ZERO {
                return radiance;
            }
            throughput *= reflected / pdf;
            let origin = offset_origin(surface.position(), surface.normal_geometric(), surface.error, direction);
            ray = Ray { origin, direction, t_max: FAR };
            hit = self.closest(&ray);
            if hit.is_miss() {
                let weight = pdf / (pdf + self.environment_pdf(direction));
                return radiance + throughput * self.sky(direction) * weight;
            }
            found = surface_at::<true>(&self.frame, &self.scene, &hit, direction);
            if found.emitted != Vec3::ZERO {
                let triangle = self.scene.world_triangle(&self.frame, hit.instance, hit.triangle);
                let doubled = triangle.doubled_area_normal().as_dvec3();
                // pdf over area times d^2 / cos, with cos = |n.d| / |n| and area = |n| / 2.
                let pdf_light = self.area_share() * 2.0 * f64::from(hit.t).powi(2)
                    / (self.triangle_count() * doubled.dot(direction.as_dvec3()).abs().max(1e-300));
                radiance += throughput * found.emitted.as_dvec3() * (pdf / (pdf + pdf_light));
            }
        }
        radiance
    }

    /// Emissive triangles.
    fn triangle_count(&self) -> f64 {
        f64::from(self.frame.light_count) - self.shapes.len() as f64
    }

    /// Probability of drawing an emissive triangle rather than the environment.
    fn area_share(&self) -> f64 {
        match (self.triangle_count() > 0.0, self.environment.is_some()) {
            (true, true) => 0.5,
            (true, false) => 1.0,
            _ => 0.0,
        }
    }

    /// Density of drawing `direction` from the environment, in sr^-1.
    fn environment_pdf(&self, direction: Vec3) -> f64 {
        let Some(table) = &self.environment else { return 0.0 };
        let d = direction.as_dvec3();
        let (sin, cos) = (f64::from(self.frame.environment_sin), f64::from(self.frame.environment_cos));
        let (x, z) = (cos * d.x - sin * d.z, cos * d.z + sin * d.x);
        let (width, height) = (self.frame.environment_width as usize, self.frame.environment_height as usize);
        let u = x.atan2(-z) / core::f64::consts::TAU + 0.5;
        let v = x.hypot(z).atan2(d.y) / core::f64::consts::PI;
        let column = ((u * width as f64) as usize).min(width - 1);
        let row = ((v * height as f64) as usize).min(height - 1);
        table.probability(row * width + column) / texel_solid_angle(&self.frame, row) * (1.0 - self.area_share())
    }

    /// Reflected light of one light sample, weighted against the BSDF's chance of finding it.
    fn light_sample(&self, surface: &Surface, bsdf: &Bsdf, rng: &mut Pcg64Mcg) -> DVec3 {
        let choice = uniform(rng);
        let found = if choice < self.area_share() {
            self.triangle_sample(surface, bsdf, rng)
        } else if let Some(table) = &self.environment {
            self.environment_sample(table, surface, bsdf, rng)
        } else {
            DVec3::ZERO
        };
        found + self.shape_sample(surface, bsdf, rng) + self.distant_sample(surface, bsdf, rng)
    }

    /// Reflected light of one shape, for all of them.
    fn shape_sample(&self, surface: &Surface, bsdf: &Bsdf, rng: &mut Pcg64Mcg) -> DVec3 {
        let Some(shape) = one_of(&self.shapes, rng) else { return DVec3::ZERO };
        let position = surface.position();
        let Some((point, irradiance)) = shape.sample(position.as_dvec3(), rng) else { return DVec3::ZERO };
        let toward = point - position.as_dvec3();
        let direction = toward.normalize().as_vec3();
        let reflected = bsdf.evaluate::<true>(direction).as_dvec3();
        if reflected == DVec3::ZERO {
            return DVec3::ZERO;
        }
        let origin = offset_origin(position, surface.normal_geometric(), surface.error, direction);
        if !self.visible(&Ray { origin, direction: point.as_vec3() - origin, t_max: 1.0 }) {
            return DVec3::ZERO;
        }
        reflected * irradiance * self.shapes.len() as f64
    }

    /// Reflected light of one directional light, for all of them.
    fn distant_sample(&self, surface: &Surface, bsdf: &Bsdf, rng: &mut Pcg64Mcg) -> DVec3 {
        let Some((direction, irradiance)) = one_of(&self.distant, rng) else { return DVec3::ZERO };
        let direction = direction.as_vec3();
        let reflected = bsdf.evaluate::<true>(direction).as_dvec3();
        let origin = offset_origin(surface.position(), surface.normal_geometric(), surface.error, direction);
        if reflected == DVec3::ZERO || !self.visible(&Ray { origin, direction, t_max: FAR }) {
            return DVec3::ZERO;
        }
        reflected * *irradiance * self.distant.len() as f64
    }

    fn triangle_sample(&self, surface: &Surface, bsdf: &Bsdf, rng: &mut Pcg64Mcg) -> DVec3 {
        let (frame, scene) = (&self.frame, &self.scene);
        let count = frame.light_count - self.shapes.len() as u32;
        let mut id = ((uniform(rng) * f64::from(count)) as u32).min(count - 1);
        // Shapes stand among them, in the order of their ids.
        self.shapes.iter().for_each(|shape| id += u32::from(shape.light <= id));
        let light::Place { instance, triangle } = light::find(frame, scene, id);
        let vertices = scene.world_triangle(frame, instance, triangle);
        let root = uniform(rng).sqrt();
        let split = uniform(rng);
        let (b, c) = ((root * (1.0 - split)) as f32, (root * split) as f32);
        let point = vertices.point(b, c);
        let doubled = vertices.doubled_area_normal().as_dvec3();
        let toward = (point - surface.position()).as_dvec3();
        let distance2 = toward.length_squared();
        let material = scene.material_of(frame, instance, triangle);
        let facing = -doubled.dot(toward);
        let two_sided = scene.material_word(material, material_record::TWO_SIDED) != 0;
        if distance2 == 0.0 || distance2.is_nan() || facing == 0.0 || (facing < 0.0 && !two_sided) {
            return DVec3::ZERO;
        }
        let mut emission = scene.emission(frame, instance, material);
        let map = scene.material_word(material, material_record::EMISSION_TEXTURE);
        if map != NO_TEXTURE {
            emission *= texture::rgb_at(frame, scene, map, scene.uv_at(frame, instance, triangle, b, c));
        }
        if self.masks && !texture::is_opaque(frame, scene, instance, triangle, b, c) {
            return DVec3::ZERO;
        }
        let direction = (toward / distance2.sqrt()).as_vec3();
        let reflected = bsdf.evaluate::<true>(direction).as_dvec3();
        if reflected == DVec3::ZERO || emission == Vec3::ZERO {
            return DVec3::ZERO;
        }
        // 1 / (light_count * area) per area, to solid angle by d^2 / cos = d^3 |n| / |n.toward|.
        let pdf = self.area_share() * 2.0 * distance2 * distance2.sqrt() / (self.triangle_count() * facing.abs());
        let normal = (doubled / doubled.length()).as_vec3();
        let origin = offset_origin(surface.position(), surface.normal_geometric(), surface.error, direction);
        let end = offset_origin(point, normal, vertices.error(), -direction);
        if !self.visible(&Ray { origin, direction: end - origin, t_max: 1.0 }) {
            return DVec3::ZERO;
        }
        let is_unseen = scene.shape_of(frame, instance) == shape::UNSEEN;
        let pdf_bsdf = if is_unseen { 0.0 } else { f64::from(bsdf.pdf_solid_angle(direction)) };
        reflected * emission.as_dvec3() / (pdf + pdf_bsdf)
    }

    fn environment_sample(
        &self,
        table: &EnvironmentTable,
        surface: &Surface,
        bsdf: &Bsdf,
        rng: &mut Pcg64Mcg,
    ) -> DVec3 {
        let (width, height) = (self.frame.environment_width as usize, f64::from(self.frame.environment_height));
        let texel = table.draw(uniform(rng));
        let (row, column) = (texel / width, texel % width);
        // Uniform over the texel's solid angle: uniform in azimuth and in the cosine of the polar angle.
        let azimuth = ((column as f64 + uniform(rng)) / width as f64 - 0.5) * core::f64::consts::TAU;
        let cosine_at = |row: usize| (row as f64 / height * core::f64::consts::PI).cos();
        let y = cosine_at(row) + (cosine_at(row + 1) - cosine_at(row)) * uniform(rng);
        let radius = (1.0 - y * y).max(0.0).sqrt();
        let (x, z) = (radius * azimuth.sin(), -radius * azimuth.cos());
        let (sin, cos) = (f64::from(self.frame.environment_sin), f64::from(self.frame.environment_cos));
        let direction = DVec3::new(cos * x + sin * z, y, cos * z - sin * x).normalize().as_vec3();
        let reflected = bsdf.evaluate::<true>(direction).as_dvec3();
        if reflected == DVec3::ZERO {
            return DVec3::ZERO;
        }
        let pdf = table.probability(texel) / texel_solid_angle(&self.frame, row) * (1.0 - self.area_share());
        let origin = offset_origin(surface.position(), surface.normal_geometric(), surface.error, direction);
        if !self.visible(&Ray { origin, direction, t_max: FAR }) {
            return DVec3::ZERO;
        }
        reflected * self.sky(direction) / (pdf + f64::from(bsdf.pdf_solid_angle(direction)))
    }
}
