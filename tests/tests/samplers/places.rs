//! Places on the image: of camera rays within a pixel, and of neighbours around it.

use glam::{UVec2, Vec3};
use weir_shared::{
    camera::camera_ray,
    frame::Frame,
    octahedral,
    reuse::{find_present, rule},
    surface::Surface,
};
use weir_tests::statistics::misfit;

/// Pixels in a row, and rows.
const SIZE: u32 = 32;
/// Pixel that everything runs for.
const PX: UVec2 = UVec2::new(16, 15);

/// Straight down at the floor, one unit a pixel, the corner of the image above the origin.
fn frame(index: u32) -> Frame {
    let half = SIZE as f32 * 0.5;
    Frame {
        width: SIZE,
        height: SIZE,
        index,
        reservoirs: 1,
        camera_rays: 1,
        camera_origin: Vec3::new(half, 1.0, half),
        camera_forward: Vec3::NEG_Y,
        camera_right: Vec3::X * half,
        camera_up: Vec3::NEG_Z * half,
        neighbor_rule: rule::DISK,
        radius_px: 7.5,
        normal_cosine: 0.9,
        plane_tolerance: 0.01,
        spatial_neighbors: 1,
        spatial_neighbors_unseen: 1,
        ..Frame::default()
    }
}

#[test]
fn camera_rays_are_uniform_over_their_pixel() {
    const CELLS: u32 = 16;
    const RAYS: u32 = 500_000;
    let mut counts = vec![0.0; (CELLS * CELLS) as usize];
    for index in 0..RAYS {
        let ray = camera_ray(PX, &frame(index));
        let hit = ray.origin - ray.direction * (ray.origin.y / ray.direction.y);
        let cell = [hit.x - PX.x as f32, hit.z - PX.y as f32].map(|place| {
            assert!((-1e-4..=1.0001).contains(&place), "beside the pixel: {place}");
            ((place * CELLS as f32).max(0.0) as u32).min(CELLS - 1)
        });
        counts[(cell[1] * CELLS + cell[0]) as usize] += 1.0;
    }
    let even = vec![f64::from(RAYS) / counts.len() as f64; counts.len()];
    assert!(misfit(&counts, &even) < 1.0, "{counts:?}");
    let mut uneven = even.clone();
    (uneven[0], uneven[1]) = (even[0] * 1.2, even[0] * 0.8);
    assert!(misfit(&counts, &uneven) > 1.0, "the check has no teeth");
}

/// Share of each pixel in the disk around [`PX`], where `area` says what part of the disk's area lies within a part of its
/// radius.
fn shares(radius_px: f64, area: impl Fn(f64) -> f64) -> Vec<f64> {
    const RINGS: u32 = 2_000;
    const ANGLES: u32 = 2_000;
    let mut shares = vec![0.0; (SIZE * SIZE) as usize];
    for ring in 0..RINGS {
        let [inner, outer] = [ring, ring + 1].map(|r| f64::from(r) / f64::from(RINGS));
        let share = (area(outer) - area(inner)) / f64::from(ANGLES);
        let radius = radius_px * 0.5 * (inner + outer);
        for angle in 0..ANGLES {
            let (sin, cos) = ((f64::from(angle) + 0.5) / f64::from(ANGLES) * std::f64::consts::TAU).sin_cos();
            let x = f64::from(PX.x) + 0.5 + radius * cos;
            let y = f64::from(PX.y) + 0.5 + radius * sin;
            shares[(y as u32 * SIZE + x as u32) as usize] += share;
        }
    }
    shares
}

#[test]
fn neighbours_are_uniform_over_the_disk() {
    const DRAWS: u32 = 500_000;
    let surface = |i: u32| Surface {
        position: [(i % SIZE) as f32, 0.0, (i / SIZE) as f32],
        normal_geometric: octahedral::pack(Vec3::Y),
        normal_shading: octahedral::pack(Vec3::Y),
        instance: 1 << 31,
        ..Surface::default()
    };
    let floor: Vec<Surface> = (0..SIZE * SIZE).map(surface).collect();
    let own = (PX.y * SIZE + PX.x) as usize;
    let mut counts = vec![0.0; floor.len()];
    let mut found = 0.0;
    for index in 0..DRAWS {
        let neighbors = find_present(PX, 0, &frame(index), &floor[own], &floor, 1);
        // Another try stands in for one that met the pixel itself.
        if neighbors.count > 0 {
            let there = neighbors.get(0);
            counts[(there.y * SIZE + there.x) as usize] += 1.0;
            found += 1.0;
        }
    }
    let expected = |area: fn(f64) -> f64| {
        let mut shares = shares(f64::from(frame(0).radius_px), area);
        shares[own] = 0.0;
        let sum: f64 = shares.iter().sum();
        shares.iter().map(|share| share / sum * found).collect::<Vec<f64>>()
    };
    assert!(found > 0.99 * f64::from(DRAWS), "{found}");
    assert!(misfit(&counts, &expected(|r| r * r)) < 1.0, "{counts:?}");
    assert!(misfit(&counts, &expected(|r| r.powf(1.8))) > 1.0, "the check has no teeth");
}
