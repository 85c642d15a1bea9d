//! Geometry: any bytes as an OBJ file, beside a material library.

#![no_main]

use libfuzzer_sys::fuzz_target;
use weir::scene::error::SceneError;
use weir::scene::load::{LoadOptions, load_from};
use weir::scene::source::Memory;

fuzz_target!(|obj: &[u8]| {
    let source = Memory::from_iter([("a.obj", obj), ("a.mtl", b"newmtl m\nKd 1 0 0\n")]);
    // A scene that is returned has passed its own validation; that it does not is a bug of the reader.
    if let Err(SceneError::Invalid { what, .. }) = load_from(&source, "a.obj", &LoadOptions::default()) {
        panic!("unsound scene: {what}");
    }
});
