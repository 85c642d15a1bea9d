//! Compiled pipelines on disk, from one run to the next.

use std::path::PathBuf;

use etcetera::{BaseStrategy, choose_base_strategy};

use crate::output::{Destination, atomic};

/// Larger files are not read: they are none of ours.
const MOST_BYTES: u64 = 256 << 20;

/// What the driver has compiled, and the file that keeps it.
#[derive(Clone)]
pub(super) struct StoredPipelines {
    cache: wgpu::PipelineCache,
    path: PathBuf,
}

impl StoredPipelines {
    /// The file of this adapter and driver; nothing where the driver keeps no pipelines or the system no cache folder.
    pub(super) fn open(adapter: &wgpu::Adapter, device: &wgpu::Device) -> Option<Self> {
        if !device.features().contains(wgpu::Features::PIPELINE_CACHE) {
            return None;
        }
        let key = wgpu::util::pipeline_cache_key(&adapter.get_info())?;
        let path = choose_base_strategy().ok()?.cache_dir().join("weir").join(key);
        let is_ours = std::fs::metadata(&path).is_ok_and(|file| file.is_file() && file.len() <= MOST_BYTES);
        let data = is_ours.then(|| std::fs::read(&path).ok()).flatten();
        let descriptor = wgpu::PipelineCacheDescriptor { label: Some("weir"), data: data.as_deref(), fallback: true };
        // SAFETY: the data is what an earlier run got from `get_data`; drivers check its header, and wgpu does as well.
        let cache = unsafe { device.create_pipeline_cache(&descriptor) };
        Some(Self { cache, path })
    }

    pub(super) fn cache(&self) -> &wgpu::PipelineCache {
        &self.cache
    }

    /// Writes the file. What can't be written is compiled again.
    pub(super) fn save(&self) {
        let Some(data) = self.cache.get_data() else { return };
        let Some(folder) = self.path.parent() else { return };
        let saved = std::fs::create_dir_all(folder).is_ok()
            && atomic::write(&Destination::File(self.path.clone()), &data).is_ok();
        if !saved {
            tracing::debug!("compiled pipelines were not kept: {}", self.path.display());
        }
    }
}
