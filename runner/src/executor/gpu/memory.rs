//! Buffers on the GPU: the scene's and the frame's, and the way back.

use std::{
    collections::BTreeMap,
    ops::Range,
    sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, mpsc},
};

use weir_shader::wiring::Access;

use super::{Gpu, GpuError, Traced, Traversal, queries::Acceleration};
use crate::{
    executor::{AlignedBytes, SceneBuffers},
    graph::{Plan, Slot},
    packed::Changed,
};

/// An empty buffer can't be bound; this much holds an element of any kind of the scene's.
const LEAST_BYTES: u64 = 16;
/// Uploads go through memory of the driver, this much at once.
const UPLOAD_BYTES: usize = 32 << 20;

/// A scene's buffers on a GPU. Copies share them, and so do all executors that are made of one.
#[derive(Clone)]
pub struct GpuScene {
    buffers: BTreeMap<&'static str, (wgpu::Buffer, u64)>,
    /// Once rays were to go by queries: what these need, or why they can't have it.
    acceleration: Arc<Mutex<Option<Result<Acceleration, String>>>>,
    /// Why the driver has refused ray queries themselves, if it has.
    refused: Arc<OnceLock<String>>,
}

impl GpuScene {
    /// Copies a scene to the GPU.
    ///
    /// # Errors
    /// If a buffer is too large for the device, or if the device fails.
    pub async fn upload(gpu: &Gpu, scene: SceneBuffers<'_>) -> Result<Self, GpuError> {
        // All sizes before the first allocation: an error must not cost minutes of upload.
        for name in SceneBuffers::NAMES {
            fits(gpu, &format!("`{name}` of the scene"), scene.bytes(name).len() as u64, "use a smaller scene")?;
        }
        let mut buffers = BTreeMap::new();
        for name in SceneBuffers::NAMES {
            let bytes = scene.bytes(name);
            // Acceleration structures are built from it.
            let is_input = name == "triangles" && gpu.facts.ray_queries.is_ok();
            let usage = if is_input { wgpu::BufferUsages::BLAS_INPUT } else { wgpu::BufferUsages::empty() };
            let buffer = storage(gpu, name, bytes.len() as u64, usage).await?;
            upload(gpu, &buffer, bytes);
            gpu.check()?;
            buffers.insert(name, (buffer, bytes.len() as u64));
        }
        Ok(Self { buffers, acceleration: Arc::default(), refused: Arc::default() })
    }

    /// Builds what ray queries need, once, if rays are to go by them; says in a warning if that is asked for in vain.
    ///
    /// # Errors
    /// If the device fails.
    pub async fn accelerate(&self, gpu: &Gpu, scene: SceneBuffers<'_>, traversal: Traversal) -> Result<(), GpuError> {
        let refused = match gpu.facts.traced(traversal) {
            Traced::Hardware => None,
            Traced::Software(why) if traversal == Traversal::Hardware => Some(why),
            Traced::Software(_) => return Ok(()),
        };
        if self.acceleration().is_some() {
            return Ok(());
        }
        let made = match refused {
            Some(why) => Err(why),
            None => Acceleration::new(gpu, scene, &self.buffers["triangles"].0).await?,
        };
        if let Err(why) = &made {
            tracing::warn!("rays are traced in software: {why}");
        }
        *self.acceleration() = Some(made);
        Ok(())
    }

    /// How rays are traced in this scene.
    pub fn traced(&self, gpu: &Gpu, traversal: Traversal) -> Traced {
        if let Some(why) = self.refused.get().filter(|_| traversal != Traversal::Software) {
            return Traced::Software(why.clone());
        }
        match (gpu.facts.traced(traversal), &*self.acceleration()) {
            (Traced::Hardware, Some(Err(why))) => Traced::Software(why.clone()),
            (Traced::Hardware, None) => Traced::Software("no acceleration structures were built".to_owned()),
            (traced, _) => traced,
        }
    }

    /// No executor to come goes by ray queries, for this reason; those that do so already go on.
    pub(super) fn refuse(&self, why: &str) {
        self.refused.get_or_init(|| why.to_owned());
    }

    pub(super) fn acceleration(&self) -> MutexGuard<'_, Option<Result<Acceleration, String>>> {
        self.acceleration.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Copies what has changed of the scene, and brings acceleration structures up to date; the next frame sees it.
    ///
    /// # Errors
    /// If a change is not within its buffer or not in whole words, or if the device fails.
    pub async fn follow(&self, gpu: &Gpu, scene: SceneBuffers<'_>, changed: &[Changed]) -> Result<(), GpuError> {
        for Changed { buffer, range } in changed {
            self.update(gpu, buffer, range.start as u64, &scene.bytes(buffer)[range.clone()])?;
        }
        let taken = if changed.is_empty() { None } else { self.acceleration().take() };
        if let Some(mut taken) = taken {
            let placed = match &mut taken {
                Ok(acceleration) => acceleration.place(gpu, scene).await,
                Err(_) => Ok(()),
            };
            *self.acceleration() = Some(taken);
            placed?;
        }
        Ok(())
    }

    /// Overwrites a part of the buffer `name` from byte `offset` on; the next frame sees it.
    ///
    /// # Errors
    /// If that is not within the buffer or not in whole words, or if the device fails.
    fn update(&self, gpu: &Gpu, name: &str, offset: u64, bytes: &[u8]) -> Result<(), GpuError> {
        let (buffer, size) = self.buffers.get(name).map_or((None, 0), |(buffer, size)| (Some(buffer), *size));
        let end = offset.saturating_add(bytes.len() as u64);
        match buffer {
            Some(buffer) if end <= size && offset.is_multiple_of(4) && end.is_multiple_of(4) => {
                gpu.queue.write_buffer(buffer, offset, bytes);
                gpu.check()
            }
            _ => Err(GpuError::OutOfRange { buffer: name.to_owned(), offset, end, bytes: size }),
        }
    }
}

/// The buffers of one plan.
pub(super) struct Memory {
    scene: GpuScene,
    pool: Vec<wgpu::Buffer>,
    history: Vec<[wgpu::Buffer; 2]>,
    zero: wgpu::Buffer,
}

impl Memory {
    /// Everything but the scene starts as zeros.
    pub(super) async fn new(gpu: &Gpu, plan: &Plan, scene: GpuScene) -> Result<Self, GpuError> {
        // All sizes before the first allocation.
        let [width, height] = [plan.facts.width, plan.facts.height];
        let of_image = |name: &str| format!("`{name}` of {width}x{height} pixels");
        for (i, &bytes) in plan.pool.iter().enumerate() {
            fits(gpu, &of_image(largest_in(plan, i)), bytes, "render at a smaller size")?;
        }
        for history in &plan.history {
            fits(gpu, &of_image(history.name), history.bytes, "render at a smaller size")?;
        }
        fits(gpu, &of_image("zeros"), plan.zero_bytes, "render at a smaller size")?;

        let bound = plan.steps.iter().flat_map(|step| step.pass.bindings.iter().zip(&step.slots));
        let uniforms: Vec<Slot> = bound.filter(|(b, _)| b.is_uniform).map(|(_, (_, slot))| *slot).collect();
        let usage_of = |slot: Slot| match uniforms.contains(&slot) {
            true => wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::INDIRECT,
            false => wgpu::BufferUsages::empty(),
        };
        let mut pool = Vec::new();
        for (i, &bytes) in plan.pool.iter().enumerate() {
            pool.push(storage(gpu, &format!("pool {i}"), bytes, usage_of(Slot::Pool(i))).await?);
        }
        let mut history = Vec::new();
        for h in &plan.history {
            let half = || storage(gpu, h.name, h.bytes, wgpu::BufferUsages::empty());
            history.push([half().await?, half().await?]);
        }
        let zero = storage(gpu, "zeros", plan.zero_bytes, usage_of(Slot::Zero)).await?;
        Ok(Self { scene, pool, history, zero })
    }

    /// The buffer behind a slot in frames of the given parity.
    pub(super) fn buffer(&self, slot: Slot, parity: usize) -> &wgpu::Buffer {
        match slot {
            Slot::Scene(name) => &self.scene.buffers.get(name).expect("every buffer of the scene was uploaded").0,
            Slot::Pool(i) => &self.pool[i],
            Slot::Current(i) => &self.history[i][parity],
            Slot::Previous(i) => &self.history[i][parity ^ 1],
            Slot::Zero => &self.zero,
        }
    }

    /// The scene.
    pub(super) fn scene(&self) -> &GpuScene {
        &self.scene
    }
}

/// The resource that sets the size of a pool's buffer.
fn largest_in(plan: &Plan, pool: usize) -> &'static str {
    let bindings = plan.steps.iter().flat_map(|s| s.names.iter().zip(&s.slots));
    let inside = bindings.filter(|(_, slot)| **slot == (Access::Write, Slot::Pool(pool)));
    inside.max_by_key(|(name, _)| plan.output_bytes(name)).map_or("pool", |(name, _)| name)
}

fn fits(gpu: &Gpu, buffer: &str, bytes: u64, remedy: &'static str) -> Result<(), GpuError> {
    let limits = gpu.device.limits();
    let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    if bytes <= limit {
        return Ok(());
    }
    let adapter = gpu.facts.name.clone();
    Err(GpuError::TooLarge { buffer: buffer.to_owned(), bytes, limit, adapter, remedy })
}

/// A buffer of zeros that passes can bind and that can be copied from.
async fn storage(gpu: &Gpu, label: &str, bytes: u64, more: wgpu::BufferUsages) -> Result<wgpu::Buffer, GpuError> {
    gpu.guarded(|| {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.max(LEAST_BYTES).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC | more,
            mapped_at_creation: false,
        })
    })
    .await
}

fn upload(gpu: &Gpu, buffer: &wgpu::Buffer, bytes: &[u8]) {
    for (i, chunk) in bytes.chunks(UPLOAD_BYTES).enumerate() {
        gpu.queue.write_buffer(buffer, (i * UPLOAD_BYTES) as u64, chunk);
        // Lets go of the driver's copy.
        gpu.queue.submit([]);
    }
}

impl Gpu {
    /// Waits for all that was submitted, and copies the first `bytes` of a buffer.
    pub(super) fn download(&self, buffer: &wgpu::Buffer, bytes: u64) -> Result<AlignedBytes, GpuError> {
        let size = bytes.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT).min(buffer.size());
        let mut copy = self.download_parts(buffer, std::slice::from_ref(&(0..size)))?;
        copy.truncate(bytes.min(size) as usize);
        Ok(copy)
    }

    /// Waits for all that was submitted, and copies parts of a buffer, in whole words, one after the other.
    pub(super) fn download_parts(&self, buffer: &wgpu::Buffer, parts: &[Range<u64>]) -> Result<AlignedBytes, GpuError> {
        let size: u64 = parts.iter().map(|part| part.end - part.start).sum();
        if size == 0 {
            return Ok(AlignedBytes::default());
        }
        let staging = pollster::block_on(self.guarded(|| {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("readback"),
                size,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        }))?;
        let mut encoder =
            self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("readback") });
        let mut at = 0;
        for part in parts {
            let bytes = part.end - part.start;
            encoder.copy_buffer_to_buffer(buffer, part.start, &staging, at, bytes);
            at += bytes;
        }
        let submission = self.queue.submit([encoder.finish()]);
        self.map(&staging, submission)
    }

    /// The contents of a buffer that can be mapped, once a submission is done.
    ///
    /// # Errors
    /// If the device fails.
    pub fn map(&self, staging: &wgpu::Buffer, submission: wgpu::SubmissionIndex) -> Result<AlignedBytes, GpuError> {
        let (sender, receiver) = mpsc::channel();
        // Nobody listens any more if the wait failed.
        staging.map_async(wgpu::MapMode::Read, .., move |mapped| drop(sender.send(mapped)));
        self.wait(Some(submission))?;
        let refused = |reason: String| GpuError::Validation(format!("`{}`: {reason}", self.facts.name));
        // Another thread's wait may be the one that answers, a moment later.
        match receiver.recv_timeout(self.patience) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(refused(error.to_string())),
            Err(error) => return Err(refused(error.to_string())),
        }
        let view = staging.get_mapped_range(..).map_err(|error| refused(error.to_string()))?;
        Ok(AlignedBytes::from_bytes(&view))
    }
}
