//! Rays by the driver's ray queries, which run on ray tracing units where the GPU has any; in place of [`crate::bvh`].
//!
//! A query says which triangle the ray meets. Where on it, and whether a mask leaves a surface there, is computed as in
//! software, so that both give the same bits wherever they find the same triangle. They may find different ones of
//! equally near triangles, and at edges, where a query rounds in its own way; a query also counts both ends of the ray in.

use spirv_std::ray_tracing::{AccelerationStructure, CommittedIntersection, RayFlags, RayQuery};

use crate::{
    frame::Frame,
    numerics::{abs, is_finite},
    ray::{Hit, Ray, max_abs},
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

/// Goes through what a query may meet, and lets it meet what no mask takes away.
#[inline(always)]
fn walk<const MASKS: bool, const INSTANCES: bool>(query: &RayQuery, frame: &Frame, scene: &Scene, ray: &Ray) {
    // SAFETY: the query was started, and asked no more once it is done.
    unsafe {
        while query.proceed() {
            if MASKS {
                let instance = query.get_candidate_intersection_instance_custom_index();
                let triangle =
                    first_triangle(frame, scene, instance) + query.get_candidate_intersection_primitive_index();
                let found = intersect::<INSTANCES>(frame, scene, ray, instance, triangle);
                if found.t > 0.0 && found.t < ray.t_max && is_opaque(frame, scene, instance, triangle, found.u, found.v)
                {
                    query.confirm_intersection();
                }
            }
        }
    }
}

impl Tracer for Queries<'_> {
    #[inline(always)]
    fn closest_hit<const MASKS: bool, const INSTANCES: bool>(self, frame: &Frame, scene: &Scene, ray: &Ray) -> Hit {
        let mut hit = Hit::miss(ray.t_max);
        if is_defined(ray) {
            spirv_std::ray_query!(let mut query);
            self.start(query, frame, ray, if MASKS { RayFlags::NONE } else { RayFlags::OPAQUE });
            walk::<MASKS, INSTANCES>(query, frame, scene, ray);
            // SAFETY: the query is done, and what is committed is asked only where something is.
            unsafe {
                if query.get_committed_intersection_type() == CommittedIntersection::Triangle {
                    let instance = query.get_committed_intersection_instance_custom_index();
                    let triangle =
                        first_triangle(frame, scene, instance) + query.get_committed_intersection_primitive_index();
                    let found = intersect::<INSTANCES>(frame, scene, ray, instance, triangle);
                    hit.instance = instance;
                    hit.triangle = triangle;
                    if found.t > 0.0 && found.t < ray.t_max {
                        hit.t = found.t;
                        hit.u = found.u;
                        hit.v = found.v;
                    } else {
                        let weights = query.get_committed_intersection_barycentrics();
                        hit.t = query.get_committed_intersection_t();
                        hit.u = weights.x;
                        hit.v = weights.y;
                    }
                }
            }
        }
        hit
    }

    #[inline(always)]
    fn unoccluded<const MASKS: bool, const INSTANCES: bool>(self, frame: &Frame, scene: &Scene, ray: &Ray) -> bool {
        let mut is_free = true;
        if is_defined(ray) {
            spirv_std::ray_query!(let mut query);
            let flags = if MASKS { RayFlags::NONE } else { RayFlags::OPAQUE };
            self.start(query, frame, ray, flags.union(RayFlags::TERMINATE_ON_FIRST_HIT));
            walk::<MASKS, INSTANCES>(query, frame, scene, ray);
            // SAFETY: the query is done.
            is_free = unsafe { query.get_committed_intersection_type() == CommittedIntersection::None };
        }
        is_free
    }
}
