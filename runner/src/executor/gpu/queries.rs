//! What ray queries need: acceleration structures of the driver, one for each mesh and, over their instances, one for each
//! of the two blocks of the scene's buffers. And whether rays go that way at all.

use std::fmt;

use weir_shader::wiring::{Binding, Pass};
use weir_shared::scene::{attribute_flags, instance_record, shape};

use super::{AdapterFacts, Gpu, GpuError};
use crate::executor::{MeshRange, SceneBuffers};

/// Instances that the 24 bits of a custom index tell apart.
const MOST_INSTANCES: u32 = 1 << 24;
/// Triangles whose acceleration structures are built together, as long as there are several meshes: the driver needs memory
/// for all that it builds at once.
const TOGETHER: u32 = 1 << 20;

/// How rays find what they meet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Traversal {
    /// By ray queries on a GPU that has them in hardware, else in software
    #[default]
    Auto,
    /// Through weir's own nodes
    Software,
    /// By ray queries wherever the driver has them
    Hardware,
}

/// How rays find what they meet in an executor, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Traced {
    /// By ray queries.
    Hardware,
    /// Through weir's own nodes, with the reason.
    Software(String),
}

impl fmt::Display for Traced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hardware => f.write_str("by ray queries"),
            Self::Software(why) => write!(f, "in software: {why}"),
        }
    }
}

/// What ray queries can take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RayLimits {
    /// Triangles of one mesh.
    pub triangles: u32,
    /// Instances.
    pub instances: u32,
}

impl AdapterFacts {
    /// How rays are traced on this adapter, as long as the scene does not exceed its limits.
    pub fn traced(&self, traversal: Traversal) -> Traced {
        let software = |why: &str| Traced::Software(why.to_owned());
        match (traversal, &self.ray_queries) {
            (Traversal::Software, _) => software("`rays.traversal=software`"),
            (_, Err(why)) => software(why),
            (Traversal::Auto, Ok(_)) if !self.prefers_queries => {
                software("the adapter is software too, where ray queries are slower")
            }
            (_, Ok(_)) => Traced::Hardware,
        }
    }
}

/// What a pass that traces rays in software reads them through.
pub(super) const NODES: &str = "bvh";

/// What a pass binds at one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// A buffer, by its place among the bindings of the pass.
    Buffer(usize),
    /// The acceleration structure of a block.
    Top(usize),
}

/// What a pass binds from number 1 on where it traces rays by queries: in place of the nodes, two acceleration structures.
pub fn bound_with_queries(pass: &Pass) -> Vec<Bound> {
    let bound = |(i, binding): (usize, &Binding)| match binding.name {
        NODES => vec![Bound::Top(0), Bound::Top(1)],
        _ => vec![Bound::Buffer(i)],
    };
    pass.bindings.iter().enumerate().flat_map(bound).collect()
}

/// An instance in an acceleration structure.
#[derive(Clone, Copy, PartialEq)]
struct Placed {
    mesh: usize,
    number: u32,
    world_from_object: [f32; 12],
}

/// The acceleration structures of a scene.
pub(super) struct Acceleration {
    /// Meshes by their first triangle, ascending.
    meshes: Vec<(MeshRange, wgpu::Blas)>,
    tops: [wgpu::Tlas; 2],
    /// What was built last into each.
    built: [Option<Vec<Placed>>; 2],
}

impl Acceleration {
    /// Builds all that a scene needs, on its triangles on the GPU.
    ///
    /// # Errors
    /// Why that can't be, in words; or that the device has failed.
    pub(super) async fn new(
        gpu: &Gpu,
        scene: SceneBuffers<'_>,
        triangles: &wgpu::Buffer,
    ) -> Result<Result<Self, String>, GpuError> {
        if let Err(why) = fits(gpu, scene) {
            return Ok(Err(why));
        }
        let made = gpu.guarded(|| Self::create(gpu, scene)).await;
        let mut made = match refused(made)? {
            Ok(made) => made,
            Err(why) => return Ok(Err(why)),
        };
        let sizes: Vec<_> = made.meshes.iter().map(|(mesh, _)| triangles_of(mesh)).collect();
        let mut first = 0;
        while first < made.meshes.len() {
            let mut end = first + 1;
            let mut sum = made.meshes[first].0.count;
            while end < made.meshes.len() && sum + made.meshes[end].0.count <= TOGETHER {
                sum += made.meshes[end].0.count;
                end += 1;
            }
            let entries: Vec<_> = made.meshes[first..end]
                .iter()
                .zip(&sizes[first..end])
                .map(|((mesh, blas), size)| wgpu::BlasBuildEntry {
                    blas,
                    geometry: wgpu::BlasGeometries::TriangleGeometries(vec![wgpu::BlasTriangleGeometry {
                        size,
                        vertex_buffer: triangles,
                        first_vertex: mesh.first * 3,
                        vertex_stride: 12,
                        index_buffer: None,
                        first_index: None,
                        transform_buffer: None,
                        transform_buffer_offset: None,
                    }]),
                })
                .collect();
            let built =
                gpu.guarded(|| submit(gpu, |encoder| encoder.build_acceleration_structures(&entries, []))).await;
            if let Err(why) = refused(built)? {
                return Ok(Err(why));
            }
            first = end;
        }
        let placed = made.place(gpu, scene).await;
        Ok(refused(placed)?.map(|()| made))
    }

    fn create(gpu: &Gpu, scene: SceneBuffers<'_>) -> Self {
        let flags = wgpu::AccelerationStructureFlags::PREFER_FAST_TRACE;
        let update_mode = wgpu::AccelerationStructureUpdateMode::Build;
        let mut meshes: Vec<_> = scene
            .placement
            .meshes
            .iter()
            .filter(|mesh| mesh.count > 0)
            .map(|mesh| {
                let descriptor = wgpu::CreateBlasDescriptor { label: Some("mesh"), flags, update_mode };
                let sizes = wgpu::BlasGeometrySizeDescriptors::Triangles { descriptors: vec![triangles_of(mesh)] };
                (*mesh, gpu.device.create_blas(&descriptor, sizes))
            })
            .collect();
        meshes.sort_by_key(|(mesh, _)| mesh.first);
        let top = || {
            gpu.device.create_tlas(&wgpu::CreateTlasDescriptor {
                label: Some("instances"),
                max_instances: scene.placement.capacity.max(1),
                flags,
                update_mode,
            })
        };
        Self { meshes, tops: [top(), top()], built: [None, None] }
    }

    /// Brings both blocks up to date.
    ///
    /// # Errors
    /// If the device fails.
    pub(super) async fn place(&mut self, gpu: &Gpu, scene: SceneBuffers<'_>) -> Result<(), GpuError> {
        for block in 0..2 {
            let placed = self.placed(scene, block);
            if self.built[block].as_ref() == Some(&placed) {
                continue;
            }
            // Until it is built: what is there is neither the one nor the other.
            self.built[block] = None;
            let Self { meshes, tops, .. } = self;
            let top = &mut tops[block];
            let capacity = top.get().len();
            let slots = top.get_mut_slice(0..capacity).into_iter().flatten();
            let mut instances = placed.iter();
            for slot in slots {
                *slot = instances.next().map(|instance| {
                    let blas = &meshes[instance.mesh].1;
                    wgpu::TlasInstance::new(blas, instance.world_from_object, instance.number, 0xff)
                });
            }
            gpu.guarded(|| submit(gpu, |encoder| encoder.build_acceleration_structures([], [&*top]))).await?;
            self.built[block] = Some(placed);
        }
        Ok(())
    }

    /// The instances of a block that rays find, from its records.
    fn placed(&self, scene: SceneBuffers<'_>, block: usize) -> Vec<Placed> {
        let [at, count] = scene.placement.blocks[block];
        let of_instance = |number: u32| {
            let record = &scene.records[(at + number * instance_record::WORDS) as usize..];
            if record[instance_record::FLAGS as usize] >> attribute_flags::SHAPE_SHIFT != shape::TRIANGLES {
                return None;
            }
            let first = record[instance_record::FIRST_TRIANGLE as usize];
            let mesh = self.meshes.binary_search_by_key(&first, |(mesh, _)| mesh.first).ok()?;
            let rows = &record[instance_record::WORLD_FROM_OBJECT as usize..];
            let world_from_object = std::array::from_fn(|i| f32::from_bits(rows[i]));
            Some(Placed { mesh, number, world_from_object })
        };
        (0..count).filter_map(of_instance).collect()
    }

    /// Over the instances of each block.
    pub(super) fn tops(&self) -> &[wgpu::Tlas; 2] {
        &self.tops
    }
}

fn submit(gpu: &Gpu, record: impl FnOnce(&mut wgpu::CommandEncoder)) {
    let descriptor = wgpu::CommandEncoderDescriptor { label: Some("acceleration structures") };
    let mut encoder = gpu.device.create_command_encoder(&descriptor);
    record(&mut encoder);
    gpu.queue.submit([encoder.finish()]);
}

/// What the driver refuses is no error: there is another way. A lost device is.
fn refused<T>(result: Result<T, GpuError>) -> Result<Result<T, String>, GpuError> {
    match result {
        Err(error @ (GpuError::Lost(_) | GpuError::Timeout(_))) => Err(error),
        Err(error) => Ok(Err(format!("the driver builds no acceleration structures: {error}"))),
        Ok(value) => Ok(Ok(value)),
    }
}

fn triangles_of(mesh: &MeshRange) -> wgpu::BlasTriangleGeometrySizeDescriptor {
    wgpu::BlasTriangleGeometrySizeDescriptor {
        vertex_format: wgpu::VertexFormat::Float32x3,
        vertex_count: mesh.count * 3,
        index_format: None,
        index_count: None,
        flags: if mesh.has_masks {
            wgpu::AccelerationStructureGeometryFlags::empty()
        } else {
            wgpu::AccelerationStructureGeometryFlags::OPAQUE
        },
    }
}

/// Whether the adapter can take the scene.
fn fits(gpu: &Gpu, scene: SceneBuffers<'_>) -> Result<(), String> {
    let limits = gpu.facts.ray_queries.map_err(str::to_owned)?;
    let largest = scene.placement.meshes.iter().map(|mesh| mesh.count).max().unwrap_or(0);
    let instances = scene.placement.capacity;
    let most = limits.instances.min(MOST_INSTANCES);
    if largest > limits.triangles {
        return Err(format!("a mesh has {largest} triangles, and the adapter takes {}", limits.triangles));
    }
    if instances > most {
        return Err(format!("there are {instances} instances, and ray queries take {most}"));
    }
    Ok(())
}
