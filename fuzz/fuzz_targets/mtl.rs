//! Materials: any bytes as a library of a scene that uses `m`. Libraries never make a scene unreadable.

#![no_main]

use libfuzzer_sys::fuzz_target;
use weir::scene::load::{LoadOptions, load_from};
use weir::scene::source::Memory;

const OBJ: &[u8] = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\nusemtl other\nf 3 2 1\n";

fuzz_target!(|mtl: &[u8]| {
    let source = Memory::from_iter([("a.obj", OBJ), ("a.mtl", mtl)]);
    match load_from(&source, "a.obj", &LoadOptions::default()) {
        Ok(_) => {}
        Err(error) => assert!(error.to_string().contains("fully transparent"), "{error}"),
    }
});
