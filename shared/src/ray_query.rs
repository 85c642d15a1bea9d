//! Rays by the driver's ray queries, which run on ray tracing units where the GPU has any; in place of [`crate::bvh`].
//!
//! A query says which triangle the ray meets. Where on it, and whether a mask leaves a surface there, is computed as in
//! software, so that both give the same bits wherever they find the same triangle. A driver's test of triangles rounds in
//! its own way, and may find the surface that a ray has just left, or that it ends on. So what is found is judged by the
//! test in software; if that does not meet it, the query is asked once more, with every candidate put to that test. They
//! may still find different ones of equally near triangles, and pass through edges that are closed in software.

use spirv_std::ray_tracing::{AccelerationStructure, CommittedIntersection, RayFlags, RayQuery};

use crate::{
    frame::Frame,
    numerics::{abs, is_finite},
    ray::{Hit, Ray, max_abs, position_error},
    scene::{Scene, instance_record},
    texture::is_opaque,
    trace::Tracer,
    triangle::{ShearedRay, TriangleHit},
};

/// Acceleration structures of the two blocks of instances, see [`Frame::block`]. Primitives count from the first
/// triangle of their mesh; the custom index of an instance is its number.
#[derive(Clone, Copy)]
pub struct Queries<'a> {
    /// Of block 0.
    pub even: &'a AccelerationStructure,
    /// Of block 1.
    pub odd: &'a AccelerationStructure,
}

/// Whether a ray may be asked: its numbers finite, the direction not zero. Others are undefined in Vulkan, and meet nothing
/// in software.
#[inline(always)]
fn is_defined(ray: &Ray) -> bool {
    let (o, d) = (ray.origin, ray.direction);
    let sum = abs(o.x) + abs(o.y) + abs(o.z) + abs(d.x) + abs(d.y) + abs(d.z);
    is_finite(sum) && max_abs(d) > 1e-30 && ray.t_max > 0.0
}

/// Where a ray meets a triangle, as in software.
#[inline(always)]
fn intersect<const INSTANCES: bool>(
    frame: &Frame,
    scene: &Scene,
    ray: &Ray,
    instance: u32,
    triangle: u32,
) -> TriangleHit {
    let mut origin = ray.origin;
    let mut direction = ray.direction;
    if INSTANCES {
        let at = scene.instance_at(frame, instance) + instance_record::OBJECT_FROM_WORLD;
        origin = scene.transform_point(at, ray.origin);
        direction = scene.transform_vector(at, ray.direction);
    }
    ShearedRay::new(origin, direction).intersect(scene.triangles, triangle)
}

#[inline(always)]
fn first_triangle(frame: &Frame, scene: &Scene, instance: u32) -> u32 {
    scene.instance_word(frame, instance, instance_record::FIRST_TRIANGLE)
}

impl Queries<'_> {
    /// Starts a query of the block that the frame shows.
    #[inline(always)]
    fn start(self, query: &mut RayQuery, frame: &Frame, ray: &Ray, flags: RayFlags) {
        const ALL: u32 = 0xff;
        // SAFETY: the ray is defined, and acceleration structures are built before passes run.
        unsafe {
            if frame.block == 0 {
                query.initialize(self.even, flags, ALL, ray.origin, 0.0, ray.direction, ray.t_max);
            } else {
                query.initialize(self.odd, flags, ALL, ray.origin, 0.0, ray.direction, ray.t_max);
            }
        }
    }
}

/// Asks a query to its end. If `careful`, it meets only what the test in software meets; else masks alone are looked at.
#[inline(always)]
fn walk<const MASKS: bool, const INSTANCES: bool>(
    query: &RayQuery,
    frame: &Frame,
    scene: &Scene,
    ray: &Ray,
    careful: bool,
) {
    // SAFETY: the query was started, and is asked no more once it is done.
    unsafe {
        while query.proceed() {
            if MASKS || careful {
                let instance = query.get_candidate_intersection_instance_custom_index();
                let triangle =
                    first_triangle(frame, scene, instance) + query.get_candidate_intersection_primitive_index();
                let found = intersect::<INSTANCES>(frame, scene, ray, instance, triangle);
                if is_within(&found, ray) && (!MASKS || is_opaque(frame, scene, instance, triangle, found.u, found.v)) {
                    query.confirm_intersection();
                }
            }
        }
    }
}

/// Whether the test in software meets the triangle between the ends of the ray.
#[inline(always)]
fn is_within(found: &TriangleHit, ray: &Ray) -> bool {
    found.t > 0.0 && found.t < ray.t_max
}

/// Flags of a query, see [`walk`].
#[inline(always)]
fn flags<const MASKS: bool>(careful: bool) -> RayFlags {
    if careful {
        RayFlags::NO_OPAQUE
    } else if MASKS {
        RayFlags::NONE
    } else {
        RayFlags::OPAQUE
    }
}

impl Tracer for Queries<'_> {
    #[inline(always)]
    fn closest_hit<const MASKS: bool, const INSTANCES: bool>(self, frame: &Frame, scene: &Scene, ray: &Ray) -> Hit {
        let mut hit = Hit::miss(ray.t_max);
        if !is_defined(ray) {
            return hit;
        }
        spirv_std::ray_query!(let mut query);
        let mut rounds = 0;
        while rounds < 2 {
            let careful = rounds == 1;
            rounds += 1;
            self.start(query, frame, ray, flags::<MASKS>(careful));
            walk::<MASKS, INSTANCES>(query, frame, scene, ray, careful);
            // SAFETY: the query is done, and what is committed is asked only where something is.
            unsafe {
                if query.get_committed_intersection_type() == CommittedIntersection::Triangle {
                    let instance = query.get_committed_intersection_instance_custom_index();
                    let triangle =
                        first_triangle(frame, scene, instance) + query.get_committed_intersection_primitive_index();
                    let found = intersect::<INSTANCES>(frame, scene, ray, instance, triangle);
                    if is_within(&found, ray) {
                        hit = Hit { t: found.t, u: found.u, v: found.v, triangle, instance };
                        rounds = 2;
                    } else if !careful {
                        // At an edge only the driver may find a surface: it counts, unless it is where the ray starts.
                        let t = query.get_committed_intersection_t();
                        if t * max_abs(ray.direction) > 16.0 * position_error(max_abs(ray.origin)) && t < ray.t_max {
                            let weights = query.get_committed_intersection_barycentrics();
                            hit = Hit { t, u: weights.x, v: weights.y, triangle, instance };
                        }
                    }
                } else {
                    rounds = 2;
                }
            }
        }
        hit
    }

    #[inline(always)]
    fn unoccluded<const MASKS: bool, const INSTANCES: bool>(self, frame: &Frame, scene: &Scene, ray: &Ray) -> bool {
        let mut is_free = true;
        if !is_defined(ray) {
            return is_free;
        }
        spirv_std::ray_query!(let mut query);
        let mut rounds = 0;
        while rounds < 2 {
            let careful = rounds == 1;
            rounds += 1;
            self.start(query, frame, ray, flags::<MASKS>(careful).union(RayFlags::TERMINATE_ON_FIRST_HIT));
            walk::<MASKS, INSTANCES>(query, frame, scene, ray, careful);
            // SAFETY: the query is done, and what is committed is asked only where something is.
            unsafe {
                if query.get_committed_intersection_type() == CommittedIntersection::Triangle {
                    let instance = query.get_committed_intersection_instance_custom_index();
                    let triangle =
                        first_triangle(frame, scene, instance) + query.get_committed_intersection_primitive_index();
                    if is_within(&intersect::<INSTANCES>(frame, scene, ray, instance, triangle), ray) {
                        is_free = false;
                        rounds = 2;
                    }
                } else {
                    rounds = 2;
                }
            }
        }
        is_free
    }
}
