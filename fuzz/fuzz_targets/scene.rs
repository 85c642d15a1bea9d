//! Pictures: any bytes as a scene and settings, three frames on the CPU.

#![no_main]

use libfuzzer_sys::fuzz_target;
use weir::{executor::cpu::Order, render::Backend, stress::arbitrary::unusable_pixels};

fuzz_target!(|bytes: &[u8]| {
    // A scene that can't be shown is refused; what is shown must be usable.
    if let Ok(Some(pixels)) = unusable_pixels(&Backend::Cpu(Order { band_rows: 16, backwards: false }), bytes) {
        assert_eq!(pixels, 0, "pixels that are negative or not finite");
    }
});
