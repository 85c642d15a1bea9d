//! `weir info`.

use std::fmt::Write;

use weir::executor::gpu::{Traversal, adapters};

/// Versions, the host and all adapters.
pub fn text() -> String {
    let mut text = format!("weir {}\n", env!("CARGO_PKG_VERSION"));
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let _ = writeln!(text, "CPU: {threads} threads, {}", node_test());
    let found = adapters();
    if found.is_empty() {
        text.push_str("GPU: none answers; pictures are computed on the CPU\n");
    }
    for (i, adapter) in found.iter().enumerate() {
        let yes = |b: bool| if b { "yes" } else { "no" };
        let mebibytes = |bytes: u64| bytes >> 20;
        let _ = writeln!(
            text,
            "GPU {i}: {} ({}, {}), driver {}",
            adapter.name, adapter.kind, adapter.backend, adapter.driver
        );
        let _ = writeln!(
            text,
            "  storage buffers a pass: {}; largest binding: {} MiB; largest buffer: {} MiB",
            adapter.storage_buffers,
            mebibytes(adapter.max_binding_bytes),
            mebibytes(adapter.max_buffer_bytes)
        );
        let _ = writeln!(
            text,
            "  SPIR-V passthrough: {}; timestamps: {}",
            yes(adapter.passthrough),
            yes(adapter.timestamps)
        );
        let _ = writeln!(text, "  rays: {}", adapter.traced(Traversal::Auto));
    }
    text
}

/// Which node test the host's traversal uses.
fn node_test() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    if weir_shared::bvh::simd::available() {
        return "AVX2";
    }
    "portable traversal"
}
