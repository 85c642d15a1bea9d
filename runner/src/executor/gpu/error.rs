//! What can go wrong on a GPU, in words.

use std::time::Duration;

use thiserror::Error;

use crate::exit::{Exit, HasExit};

/// Why the GPU did not do what it should. [`GpuError::Lost`] leaves every object of the device dead: open the GPU again.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum GpuError {
    /// No adapter at all.
    #[error("no GPU answers; install a Vulkan driver (mesa-vulkan-drivers has one in software) or use --backend cpu")]
    NoAdapter,
    /// None of that name or number.
    #[error("no adapter matches `{wanted}`; there is {found}; see `weir info`")]
    NoSuchAdapter {
        /// Name or number.
        wanted: String,
        /// Those there are.
        found: String,
    },
    /// The adapter exists, but gives no device.
    #[error("adapter `{adapter}` gives no device ({reason}); choose another one or use --backend cpu")]
    NoDevice {
        /// Its name.
        adapter: String,
        /// In the driver's words.
        reason: String,
    },
    /// A buffer that the device can't hold or bind.
    #[error(
        "{buffer} needs {} MB in one buffer, `{adapter}` allows {} MB; {remedy} or use --backend cpu",
        .bytes.div_ceil(MEGABYTE),
        .limit / MEGABYTE
    )]
    TooLarge {
        /// What it holds.
        buffer: String,
        /// What it needs.
        bytes: u64,
        /// What is allowed.
        limit: u64,
        /// The adapter's name.
        adapter: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A pass that binds more than the device can.
    #[error("pass `{pass}` binds {count} storage buffers, `{adapter}` allows {limit}; use --backend cpu")]
    TooManyBuffers {
        /// The pass.
        pass: &'static str,
        /// What it binds.
        count: usize,
        /// What is allowed.
        limit: u32,
        /// The adapter's name.
        adapter: String,
    },
    /// A window that no API can draw in.
    #[error("the window can't be drawn in by a GPU ({0}); use --backend cpu")]
    Surface(String),
    /// SPIR-V can't be handed to the driver as it is.
    #[error(
        "`{adapter}` ({backend}) takes no SPIR-V as it is; the strict module needs that, the plain one runs without"
    )]
    NoPassthrough {
        /// The adapter's name.
        adapter: String,
        /// Its API.
        backend: String,
    },
    /// The device is gone: driver reset, unplugged, or destroyed.
    #[error("the GPU was lost ({0}); open it again or use --backend cpu")]
    Lost(String),
    /// A mistake of ours that wgpu found.
    #[error("the GPU rejects a command: {0}")]
    Validation(String),
    /// The device's memory is full.
    #[error("the GPU is out of memory ({0}); render at a smaller size, use a smaller scene or use --backend cpu")]
    OutOfMemory(String),
    /// No answer in time.
    #[error("the GPU has not answered for {} s; render at a smaller size or use --backend cpu", .0.as_secs())]
    Timeout(Duration),
    /// The frame is not of the plan's size.
    #[error("the frame is {frame:?} pixels, its buffers are for {plan:?}; plan again after a change of size")]
    FrameSize {
        /// Width and height of the frame.
        frame: [u32; 2],
        /// Width and height of the plan.
        plan: [u32; 2],
    },
    /// An output nobody asked for when planning, or no frame yet.
    #[error("`{0}` is not there to read; ask for it as an output of the plan and run a frame first")]
    NoOutput(String),
    /// An update outside of a scene's buffer.
    #[error(
        "bytes {offset}..{end} of `{buffer}` can't be updated: it has {bytes}, and both ends must be multiples of 4"
    )]
    OutOfRange {
        /// The buffer.
        buffer: String,
        /// First byte.
        offset: u64,
        /// Byte after the last.
        end: u64,
        /// What it has.
        bytes: u64,
    },
}

impl From<wgpu::Error> for GpuError {
    fn from(error: wgpu::Error) -> Self {
        match error {
            wgpu::Error::OutOfMemory { source } => Self::OutOfMemory(source.to_string()),
            wgpu::Error::Validation { description, .. } | wgpu::Error::Internal { description, .. } => {
                Self::Validation(description.trim().to_owned())
            }
        }
    }
}

const MEGABYTE: u64 = 1_000_000;

impl HasExit for GpuError {
    fn exit(&self) -> Exit {
        match self {
            Self::NoAdapter
            | Self::NoSuchAdapter { .. }
            | Self::NoDevice { .. }
            | Self::TooLarge { .. }
            | Self::TooManyBuffers { .. }
            | Self::Surface(_)
            | Self::NoPassthrough { .. } => Exit::Unavailable,
            Self::Lost(_) | Self::OutOfMemory(_) | Self::Timeout(_) => Exit::Temporary,
            Self::Validation(_) | Self::FrameSize { .. } | Self::NoOutput(_) | Self::OutOfRange { .. } => {
                Exit::Internal
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_looks_larger_than_the_limit_after_rounding() {
        let (buffer, adapter) = ("`bvh` of the scene".to_owned(), "some GPU".to_owned());
        let remedy = "use a smaller scene";
        let error = GpuError::TooLarge { buffer, bytes: 134_217_729, limit: 134_217_728, adapter, remedy };
        let expected = "`bvh` of the scene needs 135 MB in one buffer, `some GPU` allows 134 MB; use a smaller scene or \
                        use --backend cpu";
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn a_missing_gpu_ends_with_another_code_than_a_lost_one() {
        assert_eq!(Exit::of(&GpuError::NoAdapter), Exit::Unavailable);
        assert_eq!(Exit::of(&GpuError::Lost("reset".into())), Exit::Temporary);
    }
}
