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

/// Mean distance of the neighbours of a pixel, in world space, and the mean angle between normals in degrees.
fn mean_differences(frame: &Frame, surfaces: &[Surface]) -> [f32; 2] {
    const STREAMS: u32 = 2_000;
    let own = surfaces[frame.index_of(OWN) as usize];
    let found = (0..STREAMS).flat_map(|stream| chosen(frame, surfaces, stream, 4));
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    for there in found.map(|px| surfaces[frame.index_of(px) as usize]) {
        let cosine = own.normal_geometric().dot(there.normal_geometric());
        sums[0] += (there.position() - own.position()).length();
        sums[1] += cosine.clamp(-1.0, 1.0).acos().to_degrees();
        count += 1.0;
    }
    assert!(count > 3.9 * STREAMS as f32, "{count} neighbours");
    sums.map(|sum| sum / count)
}

#[test]
fn compatible_neighbours_are_closer_than_those_of_a_disk() {
    for (spacing, least, most) in [(0.4, 0.2, 0.75), (1e-4, 0.98, 1.02)] {
        let (compatible, surfaces) = plane(15.0, spacing);
        let disk = Frame { neighbor_rule: rule::DISK, ..compatible };
        let [[near, _], [far, _]] = [&compatible, &disk].map(|frame| mean_differences(frame, &surfaces));
        println!("pixels {spacing} apart: {near} for compatible neighbours, {far} in the disk");
        // Where all are next to each other, the rules draw alike.
        assert!((least..most).contains(&(near / far)), "{near} of {far}");
    }
}

/// Normals turn from column to column, by less than what makes a neighbour dissimilar.
#[test]
fn compatible_neighbours_face_the_same_way_more_than_those_of_a_disk() {
    let (compatible, mut surfaces) = plane(15.0, 1e-4);
    let compatible = Frame { normal_cosine: 0.2, ..compatible };
    for (i, surface) in (0..).zip(&mut surfaces) {
        let angle = ((i % SIDE) as f32 - OWN.x as f32).to_radians() * 4.0;
        surface.normal_geometric = octahedral::pack(Vec3::new(angle.sin(), 0.0, angle.cos()));
    }
    let disk = Frame { neighbor_rule: rule::DISK, ..compatible };
    let [[_, alike], [_, unlike]] = [&compatible, &disk].map(|frame| mean_differences(frame, &surfaces));
    println!("{alike} degrees for compatible neighbours, {unlike} in the disk");
    assert!(alike < 0.8 * unlike, "{alike} of {unlike}");
}
