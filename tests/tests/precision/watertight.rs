//! Rays to edges and corners of a closed mesh: none may leak.

use glam::Vec3;
use weir::stress::geometry::leaks;

#[test]
fn ten_million_rays_to_edges_and_corners_stay_within() {
    assert_eq!(leaks(Vec3::ZERO, 10_000_000), 0);
}

/// Corners are rounded there, so faces are not those of a ball; but neighbours share theirs.
#[test]
fn far_from_the_origin_no_ray_leaks_either() {
    assert_eq!(leaks(Vec3::new(148_376.0, 1_234.0, -223_423.0), 1_000_000), 0);
}
