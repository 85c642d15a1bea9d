//! Neighbours by exponentiated keys without replacement, on a flat plane.

use glam::{UVec2, Vec3};
use weir_shared::{
    frame::Frame,
    octahedral,
    reuse::{Neighbors, Site, find_neighbors, rule},
    rng::Rng,
    surface::Surface,
};

const SIDE: u32 = 41;
const OWN: UVec2 = UVec2::new(20, 20);

fn plane(radius_px: f32, spacing: f32) -> (Frame, Vec<Surface>) {
    let frame = Frame {
        width: SIDE,
        height: SIDE,
        neighbor_rule: rule::COMPATIBLE,
        radius_px,
        normal_cosine: 0.9,
        plane_tolerance: 0.1,
        roughness_tolerance: 0.1,
        ..Frame::default()
    };
    let surface = |px: u32| Surface {
        position: [(px % SIDE) as f32 * spacing, (px / SIDE) as f32 * spacing, -10.0],
        normal_geometric: octahedral::pack(Vec3::Z),
        instance: 1 << 31,
        ..Surface::default()
    };
    (frame, (0..SIDE * SIDE).map(surface).collect())
}

fn chosen(frame: &Frame, surfaces: &[Surface], stream: u32, wanted: u32) -> Vec<UVec2> {
    let own = surfaces[(OWN.y * SIDE + OWN.x) as usize];
    let site = Site::new(&own, own.position(), Vec3::new(own.position[0], own.position[1], 0.0));
    let mut neighbors = Neighbors::around(OWN);
    let mut rng = Rng::from_words(stream, 5, 0, 0);
    let center = [OWN.x as f32 + 0.5, OWN.y as f32 + 0.5];
    find_neighbors(frame, surfaces, &site, center, OWN, wanted, &mut rng, &mut neighbors);
    (0..neighbors.count).map(|i| neighbors.get(i)).collect()
}

#[test]
fn no_pixel_is_its_own_neighbour() {
    for radius_px in [1.0, 3.0, 15.0] {
        let (frame, surfaces) = plane(radius_px, 0.01);
        assert!((0..10_000).all(|stream| !chosen(&frame, &surfaces, stream, 5).contains(&OWN)));
    }
}

/// Only where the points of the disk are some pixels apart: at radii of a few pixels two of them can meet in one.
#[test]
fn no_pixel_of_a_wide_disk_is_chosen_twice() {
    let (frame, surfaces) = plane(15.0, 0.01);
    for stream in 0..10_000 {
        let found = chosen(&frame, &surfaces, stream, 5);
        assert_eq!(found.len(), 5);
        assert!((1..found.len()).all(|i| !found[..i].contains(&found[i])), "stream {stream}: {found:?}");
    }
}
