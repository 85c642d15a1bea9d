//! Environment maps: any bytes as a Radiance HDR or OpenEXR file.

#![no_main]

use libfuzzer_sys::fuzz_target;
use weir::scene::environment;

fuzz_target!(|file: &[u8]| {
    if let Ok((map, _)) = environment::decode(file, "sky", 0.0, 1.0) {
        assert_eq!(map.texels.len(), map.width as usize * map.height as usize);
        assert!(map.texels.as_flattened().iter().all(|value| value.is_finite() && *value >= 0.0));
    }
});
