//! The lamps above a surface, cut into cells of (light, u, v).

use glam::{Mat4, UVec2, Vec3};
use weir::{
    packed::{Moment, PackOptions, PackedScene},
    scene::{DistantLight, Instance, Motion, Scene, Shape, lights},
};
use weir_shader::wiring::Feature;
use weir_shared::{
    bvh::unoccluded,
    environment,
    frame::Frame,
    light::{self, ENVIRONMENT_BIT, LightPoint, source},
    numerics::{pack_cell, pack_unorm16},
    octahedral,
    scene::Scene as SceneView,
    surface::Surface,
    target::Domain,
};
use weir_tests::scenes::lamps;

/// The pixel that everything runs for, of 2x2: off the lattice, where there is one.
pub const PX: UVec2 = UVec2::new(1, 0);

/// Cells along each side of a lamp.
const SIDE: u32 = 2;
/// Points along each side of a cell for integrals over it.
const FINE: u32 = 24;

/// A surface at the origin, and what may be above it.
pub struct Bench {
    pub packed: PackedScene,
    pub surface: Surface,
    /// The same for each pixel.
    pub surfaces: Vec<Surface>,
}

/// A cell, integrated over.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Size in units of (u, v).
    pub size: f64,
    /// Probability that a direction from the BSDF ends there, shadows regarded.
    pub bsdf: f64,
    /// Whether every point reaches the surface.
    pub is_lit: bool,
}

impl Bench {
    pub fn new(sky: bool, specular: f32, roughness: f32) -> Self {
        Self::of(&lamps(sky), specular, roughness)
    }

    /// With lights that are no triangles, and no sky.
    pub fn with_shapes(specular: f32, roughness: f32) -> Self {
        let mut scene = lamps(false);
        let down = Vec3::NEG_Y;
        let spot = Shape::Spot { inner_deg: 20.0, outer_deg: 50.0 };
        let (x, y) = (Vec3::X * 0.2, Vec3::Z * 0.3);
        let panel =
            Mat4::from_cols(x.extend(0.0), y.extend(0.0), down.extend(0.0), Vec3::new(0.9, 1.7, 0.4).extend(1.0));
        for (shape, emission, world_from_object) in [
            (Shape::Point, Vec3::new(1.0, 2.0, 0.5), Mat4::from_translation(Vec3::new(-0.7, 0.9, 0.3))),
            (Shape::Point, Vec3::splat(0.3), Mat4::from_translation(Vec3::new(0.1, 0.4, 0.8))),
            (spot, Vec3::new(3.0, 1.0, 1.0), lights::along(Vec3::new(0.2, 1.4, 0.5), down)),
            (Shape::Rectangle, Vec3::splat(2.0), panel),
        ] {
            let mesh = lights::add_shape(&mut scene, shape, emission, false);
            scene.instances.push(Instance { mesh, world_from_object, motion: Motion::Still });
        }
        let direction = Vec3::new(0.3, -0.9, -0.1).normalize();
        scene.distant.push(DistantLight { direction, irradiance: Vec3::new(0.2, 0.3, 0.4) });
        scene.distant.push(DistantLight { direction: down, irradiance: Vec3::splat(0.5) });
        Self::of(&scene, specular, roughness)
    }

    fn of(scene: &Scene, specular: f32, roughness: f32) -> Self {
        let options = PackOptions { light_cuts: true, ..PackOptions::default() };
        let mut packed = PackedScene::with(scene, &Moment::default(), options).expect("packs");
        packed.frame = Frame {
            width: 2,
            height: 2,
            reservoirs: 1,
            camera_origin: Vec3::new(0.6, 1.0, 2.0),
            source: source::POWER,
            ..packed.frame
        };
        let surface = Surface {
            normal_geometric: octahedral::pack(Vec3::Y),
            normal_shading: octahedral::pack(Vec3::Y),
            specular_rg: pack_unorm16(specular) * 0x1_0001,
            specular_b_roughness: pack_unorm16(specular) | (pack_unorm16(roughness) << 16),
            diffuse: [0.5, 0.4, 0.3],
            instance: 1 << 31,
            ..Surface::default()
        };
        Self { packed, surface, surfaces: vec![surface; 4] }
    }

    /// Whether there are lights other than triangles.
    pub fn has_others(&self) -> bool {
        self.packed.content.features().contains(&Feature::ENVIRONMENT)
    }

    pub fn view(&self) -> SceneView<'_> {
        let PackedScene { triangles, records, texels, .. } = &self.packed;
        SceneView { triangles, records, texels }
    }

    pub fn domain(&self) -> Domain {
        Domain::new(self.packed.frame.camera_origin, &self.surface)
    }

    /// The frame of trial `index`.
    pub fn frame(&self, index: u32) -> Frame {
        Frame { index, ..self.packed.frame }
    }

    fn lamp_cells(&self) -> usize {
        (self.packed.frame.light_count * SIDE * SIDE) as usize
    }

    /// The cell of a sample. A texel of the sky is one, and a directional light.
    pub fn cell_of(&self, light: u32, uv: u32) -> usize {
        if light & ENVIRONMENT_BIT != 0 {
            return self.lamp_cells() + (light & !ENVIRONMENT_BIT) as usize;
        }
        let (u, v) = (((uv & 0xffff) * SIDE) >> 16, ((uv >> 16) * SIDE) >> 16);
        ((light * SIDE + v) * SIDE + u) as usize
    }

    /// The light of a cell; all that is infinitely far away is one.
    pub fn light_of(&self, cell: usize) -> usize {
        cell.min(self.lamp_cells()) / (SIDE * SIDE) as usize
    }

    fn is_visible(&self, point: &LightPoint) -> bool {
        let ray = light::shadow_ray::<true>(&self.surface, point);
        unoccluded::<false, true>(&self.packed.frame, &self.view(), &self.packed.bvh, &ray)
    }

    /// All cells, by the midpoint rule.
    pub fn cells(&self) -> Vec<Cell> {
        let frame = &self.packed.frame;
        let texels = environment::count(frame);
        let domain = self.domain();
        let cell = |light: u32, u0: f32, v0: f32, side: f32| {
            let points = FINE * FINE;
            let mut cell = Cell { size: f64::from(side * side), bsdf: 0.0, is_lit: true };
            for i in 0..points {
                let along = |i: u32| side * (i as f32 + 0.5) / FINE as f32;
                let uv = pack_cell(u0 + along(i % FINE), v0 + along(i / FINE));
                let point = light::evaluate::<false, true>(frame, &self.view(), light, uv);
                let (target, bsdf) = domain.target_and_density::<true, true>(&point);
                let is_above = light::arriving::<true>(domain.position, &point).direction.y > 0.0;
                let is_seen = is_above && self.is_visible(&point);
                cell.bsdf += if is_seen { f64::from(bsdf) * cell.size / f64::from(points) } else { 0.0 };
                cell.is_lit &= is_seen && target > 0.0;
            }
            cell
        };
        let step = 1.0 / SIDE as f32;
        let lamps = (0..frame.light_count * SIDE * SIDE).map(|i| {
            let (light, v, u) = (i / (SIDE * SIDE), i / SIDE % SIDE, i % SIDE);
            cell(light, u as f32 * step, v as f32 * step, step)
        });
        lamps.chain((0..texels).map(|texel| cell(texel | ENVIRONMENT_BIT, 0.0, 0.0, 1.0))).collect()
    }
}
