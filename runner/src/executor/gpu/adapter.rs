//! Adapters: which there are, which to take, and what is asked of its device.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    str::FromStr,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use super::{GpuError, RayLimits, pipelines::Cache, stored::StoredPipelines};

/// Which adapter to use.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// What `WGPU_ADAPTER_NAME` names, or else the fastest kind there is; in software if there is no other.
    #[default]
    Best,
    /// By its number in [`adapters`].
    Index(usize),
    /// By a part of its name, in any case.
    Name(String),
}

impl FromStr for AdapterChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text.parse() {
            Ok(index) => Self::Index(index),
            Err(_) => Self::Name(text.to_owned()),
        })
    }
}

/// What matters about an adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterFacts {
    /// As the driver calls it.
    pub name: String,
    /// The API it is reached by.
    pub backend: String,
    /// Discrete, integrated, virtual or in software.
    pub kind: &'static str,
    /// Name and version of the driver.
    pub driver: String,
    /// Storage buffers that a pass can bind.
    pub storage_buffers: u32,
    /// Largest part of a buffer that can be bound, in bytes.
    pub max_binding_bytes: u64,
    /// Largest buffer, in bytes.
    pub max_buffer_bytes: u64,
    /// Whether SPIR-V reaches the driver as it is.
    pub passthrough: bool,
    /// Whether the time of a pass can be measured.
    pub timestamps: bool,
    /// What ray queries can take, or why they can't be used.
    pub ray_queries: Result<RayLimits, &'static str>,
    /// Whether rays go by queries unless told otherwise: not where these run in software.
    pub prefers_queries: bool,
}

/// The instance, as the variables `WGPU_BACKEND`, `WGPU_VALIDATION`, `WGPU_DEBUG` and their kin ask for it; but for
/// `WGPU_VALIDATION_INDIRECT_CALL`.
pub fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    // That is a pass of wgpu's own before each dispatch. Numbers of workgroups are written by a pass that bounds them: at most
    // as many as a list has tiles, as a tile has blocks, and as a pixel has candidates, all of them below 65,536.
    descriptor.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
    wgpu::Instance::new(descriptor)
}

/// All adapters that can run compute passes, the one that [`AdapterChoice::Best`] takes first.
pub fn adapters() -> Vec<AdapterFacts> {
    pollster::block_on(ranked(&instance(), None)).iter().map(facts).collect()
}

async fn ranked(instance: &wgpu::Instance, surface: Option<&wgpu::Surface<'_>>) -> Vec<wgpu::Adapter> {
    let mut found = instance.enumerate_adapters(wgpu::Backends::all()).await;
    found.retain(|adapter| {
        let flags = adapter.get_downlevel_capabilities().flags;
        let shows = surface.is_none_or(|surface| adapter.is_surface_supported(surface));
        flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS | wgpu::DownlevelFlags::INDIRECT_EXECUTION) && shows
    });
    // Stable: among equals, the system's order.
    found.sort_by_key(|adapter| match adapter.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    });
    found
}

fn facts(adapter: &wgpu::Adapter) -> AdapterFacts {
    let (info, limits, features) = (adapter.get_info(), adapter.limits(), adapter.features());
    AdapterFacts {
        backend: info.backend.to_string(),
        kind: match info.device_type {
            wgpu::DeviceType::DiscreteGpu => "discrete",
            wgpu::DeviceType::IntegratedGpu => "integrated",
            wgpu::DeviceType::VirtualGpu => "virtual",
            wgpu::DeviceType::Cpu => "software",
            wgpu::DeviceType::Other => "unknown",
        },
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        storage_buffers: limits.max_storage_buffers_per_shader_stage,
        max_binding_bytes: limits.max_storage_buffer_binding_size,
        max_buffer_bytes: limits.max_buffer_size,
        passthrough: info.backend == wgpu::Backend::Vulkan && features.contains(wgpu::Features::PASSTHROUGH_SHADERS),
        timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
        ray_queries: ray_queries(adapter),
        prefers_queries: info.device_type != wgpu::DeviceType::Cpu,
        name: info.name,
    }
}

fn ray_queries(adapter: &wgpu::Adapter) -> Result<RayLimits, &'static str> {
    let (limits, features) = (adapter.limits(), adapter.features());
    if !features.contains(wgpu::Features::EXPERIMENTAL_RAY_QUERY) {
        return Err("the adapter has no ray queries");
    }
    if adapter.get_info().backend != wgpu::Backend::Vulkan || !features.contains(wgpu::Features::PASSTHROUGH_SHADERS) {
        return Err("the adapter takes no SPIR-V as it is, which ray queries need");
    }
    if limits.max_acceleration_structures_per_shader_stage < 2 {
        return Err("a pass can't bind the two acceleration structures that the two last frames need");
    }
    Ok(RayLimits { triangles: limits.max_blas_primitive_count, instances: limits.max_tlas_instance_count })
}

/// The device of an adapter, with all that weir can make use of.
async fn request(
    adapter: &wgpu::Adapter,
    has_ray_queries: bool,
) -> Result<(wgpu::Device, wgpu::Queue), wgpu::RequestDeviceError> {
    let offered = adapter.limits();
    let wanted = wgpu::Features::PASSTHROUGH_SHADERS | wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::PIPELINE_CACHE;
    let lowest = wgpu::Limits::downlevel_defaults().using_resolution(offered.clone()).using_alignment(offered.clone());
    // What weir depends on is asked for in full; the rest is what every adapter has.
    let limits = wgpu::Limits {
        max_storage_buffers_per_shader_stage: offered.max_storage_buffers_per_shader_stage,
        max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
        max_buffer_size: offered.max_buffer_size,
        ..lowest
    };
    let plain = wgpu::DeviceDescriptor {
        label: Some("weir"),
        required_features: adapter.features() & wanted,
        required_limits: limits.clone(),
        ..Default::default()
    };
    if !has_ray_queries {
        return adapter.request_device(&plain).await;
    }
    let descriptor = wgpu::DeviceDescriptor {
        required_features: plain.required_features | wgpu::Features::EXPERIMENTAL_RAY_QUERY,
        required_limits: wgpu::Limits {
            max_blas_primitive_count: offered.max_blas_primitive_count,
            max_blas_geometry_count: offered.max_blas_geometry_count,
            max_tlas_instance_count: offered.max_tlas_instance_count,
            max_acceleration_structures_per_shader_stage: offered.max_acceleration_structures_per_shader_stage,
            ..limits
        },
        // SAFETY: wgpu does not yet promise that its ray queries are sound. What is asked of them is checked against
        // traversal in software.
        experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
        ..plain
    };
    adapter.request_device(&descriptor).await
}

/// What the device has reported since it was opened.
#[derive(Default)]
struct Health {
    lost: Mutex<Option<String>>,
    errors: Mutex<Vec<GpuError>>,
}

/// A lock whose holder can't have left it half-written.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An open GPU. Copies share one device.
#[derive(Clone)]
pub struct Gpu {
    /// Where surfaces come from.
    pub instance: wgpu::Instance,
    /// The adapter.
    pub adapter: wgpu::Adapter,
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// What matters about the adapter.
    pub facts: AdapterFacts,
    /// How long to wait for an answer before [`GpuError::Timeout`].
    pub patience: Duration,
    health: Arc<Health>,
    cache: Arc<Mutex<Cache>>,
    stored: Option<StoredPipelines>,
}

impl Gpu {
    /// Opens an adapter, and blocks until it is open.
    ///
    /// # Errors
    /// If there is no such adapter, or if its driver gives no device.
    pub fn open(choice: &AdapterChoice) -> Result<Self, GpuError> {
        pollster::block_on(Self::open_on(instance(), choice, None))
    }

    /// Opens an adapter that can show its pictures on `surface`, if there is one.
    ///
    /// # Errors
    /// As [`Gpu::open`].
    pub async fn open_on(
        instance: wgpu::Instance,
        choice: &AdapterChoice,
        surface: Option<&wgpu::Surface<'_>>,
    ) -> Result<Self, GpuError> {
        let adapter = choose(ranked(&instance, surface).await, choice)?;
        let mut facts = facts(&adapter);
        let opened = match request(&adapter, facts.ray_queries.is_ok()).await {
            Err(_) if facts.ray_queries.is_ok() => {
                facts.ray_queries = Err("the adapter gives no device with ray queries");
                request(&adapter, false).await
            }
            opened => opened,
        };
        let (device, queue) =
            opened.map_err(|error| GpuError::NoDevice { adapter: facts.name.clone(), reason: error.to_string() })?;

        // Without these two, wgpu panics.
        let health = Arc::new(Health::default());
        let seen = Arc::clone(&health);
        device.on_uncaptured_error(Arc::new(move |error| lock(&seen.errors).push(GpuError::from(error))));
        let seen = Arc::clone(&health);
        device.set_device_lost_callback(move |reason, message| {
            lock(&seen.lost).get_or_insert_with(|| format!("{reason:?}: {message}"));
        });
        let stored = StoredPipelines::open(&adapter, &device);
        Ok(Self {
            instance,
            adapter,
            device,
            queue,
            facts,
            patience: Duration::from_secs(120),
            health,
            cache: Arc::default(),
            stored,
        })
    }

    /// What the device has compiled.
    pub(super) fn cache(&self) -> MutexGuard<'_, Cache> {
        lock(&self.cache)
    }

    /// What was compiled in an earlier run, where the driver can use it.
    pub(super) fn stored_pipelines(&self) -> Option<&wgpu::PipelineCache> {
        self.stored.as_ref().map(StoredPipelines::cache)
    }

    /// Keeps what was compiled for the next run, where the driver can tell.
    pub fn store_pipelines(&self) {
        if let Some(stored) = &self.stored {
            stored.save();
        }
    }

    /// Whether SPIR-V can be handed to the driver as it is.
    pub fn has_passthrough(&self) -> bool {
        self.facts.passthrough
    }

    /// Whether it divides and takes square roots as exactly as the host: software does; Vulkan allows hardware to be off by
    /// 2.5 units in the last place.
    pub fn rounds_exactly(&self) -> bool {
        self.facts.kind == "software"
    }

    /// Asks the device how it is, without waiting.
    ///
    /// # Errors
    /// That it is lost, or else the first error since the last call.
    pub fn check(&self) -> Result<(), GpuError> {
        // Timeouts can't happen without a wait, and a loss arrives at the callback.
        let _ = self.poll(wgpu::PollType::Poll);
        self.report()
    }

    fn report(&self) -> Result<(), GpuError> {
        if !lock(&self.health.errors).is_empty() {
            // The callback of a loss comes only when the queue has run dry, after errors that the loss has caused.
            let _ = self.poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(self.patience) });
        }
        if let Some(reason) = &*lock(&self.health.lost) {
            return Err(GpuError::Lost(reason.clone()));
        }
        match std::mem::take(&mut *lock(&self.health.errors)).into_iter().next() {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// Waits until a submission, or all of them, are done.
    ///
    /// # Errors
    /// [`GpuError::Timeout`] after [`Gpu::patience`], or what the device has reported.
    pub fn wait(&self, submission: Option<wgpu::SubmissionIndex>) -> Result<(), GpuError> {
        let polled = self.poll(wgpu::PollType::Wait { submission_index: submission, timeout: Some(self.patience) });
        // A lost device also answers that the submission is unknown: the loss is the better word.
        self.report()?;
        match polled {
            Err(wgpu::PollError::Timeout) => Err(GpuError::Timeout(self.patience)),
            Err(error) => Err(GpuError::Validation(error.to_string())),
            Ok(_) => Ok(()),
        }
    }

    fn poll(&self, kind: wgpu::PollType) -> Result<wgpu::PollStatus, wgpu::PollError> {
        // wgpu 30 panics in `poll` when the driver reports a loss.
        catch_unwind(AssertUnwindSafe(|| self.device.poll(kind))).unwrap_or_else(|_| {
            lock(&self.health.lost).get_or_insert_with(|| "the driver reports it while waiting".to_owned());
            Ok(wgpu::PollStatus::QueueEmpty)
        })
    }

    /// Makes objects, and returns the first error that this causes.
    ///
    /// # Errors
    /// That error, or what the device has reported.
    pub async fn guarded<T>(&self, make: impl FnOnce() -> T) -> Result<T, GpuError> {
        let filters = [wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Validation];
        let scopes = filters.map(|filter| self.device.push_error_scope(filter));
        let made = make();
        let mut first = None;
        for scope in scopes.into_iter().rev() {
            first = scope.pop().await.or(first);
        }
        self.check()?;
        match first {
            Some(error) => Err(error.into()),
            None => Ok(made),
        }
    }

    /// Destroys the device: what follows sees a loss, as after a reset of the driver.
    pub fn lose(&self) {
        self.device.destroy();
    }
}

fn choose(mut found: Vec<wgpu::Adapter>, choice: &AdapterChoice) -> Result<wgpu::Adapter, GpuError> {
    let by_env = std::env::var("WGPU_ADAPTER_NAME").ok().filter(|name| !name.is_empty());
    let names: Vec<String> = found.iter().map(|adapter| adapter.get_info().name).collect();
    let named = |part: &str| names.iter().position(|name| name.to_lowercase().contains(&part.to_lowercase()));
    let (index, wanted) = match (choice, by_env) {
        (AdapterChoice::Index(index), _) => (Some(*index), index.to_string()),
        (AdapterChoice::Name(name), _) => (named(name), name.clone()),
        (AdapterChoice::Best, Some(name)) => (named(&name), name),
        (AdapterChoice::Best, None) => (Some(0), String::new()),
    };
    match index {
        _ if found.is_empty() => Err(GpuError::NoAdapter),
        Some(index) if index < found.len() => Ok(found.swap_remove(index)),
        _ => Err(GpuError::NoSuchAdapter { wanted, found: names.join(", ") }),
    }
}

#[cfg(test)]
mod tests {
    use super::AdapterChoice;

    #[test]
    fn a_number_chooses_by_place_and_anything_else_by_name() {
        assert_eq!("2".parse(), Ok(AdapterChoice::Index(2)));
        assert_eq!("RTX 4090".parse(), Ok(AdapterChoice::Name("RTX 4090".into())));
        assert_eq!("-1".parse(), Ok(AdapterChoice::Name("-1".into())));
    }
}
