//! How long each pass took, in the clock of the GPU.

use std::{sync::mpsc, time::Duration};

use super::Gpu;

/// Room for the times of one frame in flight.
pub(super) struct Timer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readable: wgpu::Buffer,
    mapped: Option<mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>>,
}

impl Timer {
    /// Room for the given number of passes.
    pub(super) fn new(gpu: &Gpu, passes: usize) -> Self {
        let count = 2 * passes as u32;
        let buffer = |label, usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: 8 * u64::from(count),
                usage,
                mapped_at_creation: false,
            })
        };
        Self {
            queries: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("times"),
                ty: wgpu::QueryType::Timestamp,
                count,
            }),
            resolved: buffer("times", wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            readable: buffer("times, readable", wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST),
            mapped: None,
        }
    }

    /// What a pass must be begun with.
    pub(super) fn around(&self, pass: usize) -> wgpu::ComputePassTimestampWrites<'_> {
        let first = 2 * pass as u32;
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    /// After the last pass: brings the times to where the host can read them.
    pub(super) fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.resolve_query_set(&self.queries, 0..self.resolved.size() as u32 / 8, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.readable, 0, self.resolved.size());
    }

    /// After submission: asks for the times.
    pub(super) fn request(&mut self) {
        let (sender, receiver) = mpsc::channel();
        // Nobody listens any more if the executor is gone.
        self.readable.map_async(wgpu::MapMode::Read, .., move |mapped| drop(sender.send(mapped)));
        self.mapped = Some(receiver);
    }

    /// Once the frame is done: the times of its passes.
    pub(super) fn collect(&mut self, gpu: &Gpu) -> Option<Vec<Duration>> {
        // Another thread's wait may be the one that answers, a moment later.
        match self.mapped.take()?.recv_timeout(gpu.patience) {
            Ok(mapped) => mapped.ok()?,
            Err(_) => {
                self.readable.unmap();
                return None;
            }
        }
        let view = self.readable.get_mapped_range(..).ok()?;
        let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&view);
        drop(view);
        self.readable.unmap();
        let period = f64::from(gpu.queue.get_timestamp_period());
        // Some drivers' clocks run backwards between queues or after a change of frequency.
        let nanoseconds = ticks.chunks_exact(2).map(|t| t[1].saturating_sub(t[0]) as f64 * period);
        Some(nanoseconds.map(|ns| Duration::from_nanos(ns as u64)).collect())
    }
}
