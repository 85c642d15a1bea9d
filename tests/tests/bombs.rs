//! Small files that promise or hold too much: refused fast, and without reserving what they ask for.

mod peak;

use std::io::{Cursor, Read};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use exr::image::Encoding;
use exr::prelude::{Blocks, LayerAttributes, WritableImage};
use weir::scene::environment;
use weir::scene::load::{LoadOptions, Loaded, load_from};
use weir::scene::source::{Memory, Opened, Source, SourceError};

/// Memory is measured for the whole process.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

const MAX_BYTES: usize = 64 << 20;
/// Ten times what any of them takes, for busy machines.
const MAX_TIME: Duration = Duration::from_millis(500);

/// Runs `work` within the limits; `name` is for the message.
fn cheaply<T>(name: &str, work: impl FnOnce() -> T) -> T {
    let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let start = Instant::now();
    let (result, bytes) = peak::measure(work);
    assert!(bytes < MAX_BYTES, "{name} took {bytes} bytes");
    assert!(start.elapsed() < MAX_TIME, "{name} took {:?}", start.elapsed());
    result
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg()))
    })
}

/// A PNG that says it has these many pixels, followed by hardly any data.
fn png(width: u32, height: u32) -> Vec<u8> {
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |kind: &[u8], data: &[u8]| {
        file.extend((data.len() as u32).to_be_bytes());
        let body = [kind, data].concat();
        file.extend(&body);
        file.extend(crc32(&body).to_be_bytes());
    };
    chunk(b"IHDR", &[&width.to_be_bytes()[..], &height.to_be_bytes(), &[8, 6, 0, 0, 0]].concat());
    chunk(b"IDAT", &[0x78, 0x9c, 3, 0, 0, 0, 0, 1]);
    chunk(b"IEND", &[]);
    file
}

/// The triangle that shows `texture.png`.
fn scene_with(texture: &[u8]) -> Memory {
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    let mtl = "newmtl m\nmap_Kd texture.png\n";
    Memory::from_iter([("a.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes()), ("texture.png", texture)])
}

#[test]
fn images_that_promise_too_much_are_left_out() {
    for (width, height) in [(30_000, 30_000), (16_384, 16_384), (10_000, 10_000), (u32::MAX >> 1, 1), (0, 7)] {
        let source = scene_with(&png(width, height));
        let name = format!("PNG {width}x{height}");
        let loaded = cheaply(&name, || load_from(&source, "a.obj", &LoadOptions::default()));
        let Loaded { scene, warnings } = loaded.expect("a texture is not worth an error");
        assert!(scene.textures.is_empty() && scene.materials[0].base_color_texture.is_none());
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        let warning = warnings[0].to_string();
        assert!(warning.starts_with("a.mtl:2: texture `texture.png` is left out: "), "{warning}");
    }
}

#[test]
fn radiance_maps_that_promise_too_much_are_refused() {
    for (width, height) in [(20_000, 8_000), (8_000, 4_000), (16_384, 2_000)] {
        let file = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n\u{2}\u{2}");
        let result = cheaply("HDR", || environment::decode(file.as_bytes(), "sky.hdr", 0.0, 1.0));
        let error = result.expect_err("a bomb").to_string();
        assert!(error.starts_with("sky.hdr: ") && error.contains("\nhelp: use an equirectangular"), "{error}");
    }
}

fn exr_map(blocks: Blocks) -> Vec<u8> {
    let pixel = |at: exr::math::Vec2<usize>| (at.x() as f32, at.y() as f32 * 0.5, 1.0_f32);
    let encoding = Encoding { blocks, ..Encoding::SMALL_LOSSLESS };
    let channels = exr::image::SpecificChannels::rgb(pixel);
    let layer = exr::image::Layer::new((64, 32), LayerAttributes::default(), encoding, channels);
    let mut file = Cursor::new(Vec::new());
    exr::image::Image::from_layer(layer).write().to_buffered(&mut file).expect("memory");
    file.into_inner()
}

const TILES: Blocks = Blocks::Tiles(exr::math::Vec2(16, 16));

/// Where the value of an attribute begins: behind its name, its type and its length.
fn attribute(file: &[u8], name_and_type: &[u8]) -> usize {
    let at = file.windows(name_and_type.len()).position(|bytes| bytes == name_and_type);
    at.expect("an attribute") + name_and_type.len() + 4
}

/// Each byte of the header and of the block table changed, one at a time and in three ways.
///
/// The decoder reserves what a tile claims to have, as far as the size of tiles in the header allows: gigabytes, where
/// nobody compares that size with the image.
#[test]
fn damaged_exr_headers_never_reserve_much_memory() {
    for sound in [exr_map(Blocks::ScanLines), exr_map(TILES)] {
        environment::decode(&sound, "sky.exr", 0.0, 1.0).expect("sound");
        for index in 0..sound.len().min(600) {
            for change in [0x01, 0x80, 0xff] {
                let mut damaged = sound.clone();
                damaged[index] ^= change;
                // Either it is refused, or it is an image of some kind.
                let name = format!("EXR with byte {index} ^ {change}");
                _ = cheaply(&name, || environment::decode(&damaged, "sky.exr", 0.0, 1.0));
            }
        }
    }
}

#[test]
fn exr_windows_that_the_file_cannot_fill_are_refused() {
    let sound = exr_map(Blocks::ScanLines);
    // The corners of the window: xMin, yMin, xMax, yMax.
    let at = attribute(&sound, b"dataWindow\0box2i\0");
    for (x_max, y_max) in [(8191_u32, 4095_u32), (30_000, 30_000), (1 << 20, 31), (63, 1 << 29)] {
        let mut bomb = sound.clone();
        bomb[at + 8..at + 12].copy_from_slice(&x_max.to_le_bytes());
        bomb[at + 12..at + 16].copy_from_slice(&y_max.to_le_bytes());
        let result = cheaply("EXR", || environment::decode(&bomb, "sky.exr", 0.0, 1.0));
        let error = result.expect_err("a bomb").to_string();
        assert!(error.starts_with("sky.exr: ") && error.contains("\nhelp: "), "{error}");
    }
}

#[test]
fn geometry_costs_memory_in_proportion_to_its_text() {
    let mut obj = String::from("v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    (0..400_000).for_each(|_| obj.push_str("f 1 2 3\n"));
    let source = Memory::from_iter([("a.obj", &obj)]);
    let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let (loaded, bytes) = peak::measure(|| load_from(&source, "a.obj", &LoadOptions::default()));
    assert_eq!(loaded.expect("loads").scene.triangle_count(), 400_000);
    assert!(bytes < 16 * obj.len() + MAX_BYTES, "{bytes} bytes for {} bytes of text", obj.len());
}

/// A file of two gigabytes that never was on a disk: the same line, over and over.
struct Endless(&'static [u8]);

const GIGABYTES: u64 = 2 << 30;

impl Source for Endless {
    fn open(&self, name: &str) -> Result<Opened, SourceError> {
        let reader = Box::new(Lines { line: self.0, left: self.0, count: GIGABYTES / self.0.len() as u64 });
        Ok(Opened { key: name.into(), path: name.into(), bytes: GIGABYTES, reader })
    }

    fn find(&self, _base_name: &str) -> Option<String> {
        None
    }
}

struct Lines {
    line: &'static [u8],
    /// Of the line that is being read.
    left: &'static [u8],
    /// Lines, this one among them.
    count: u64,
}

impl Read for Lines {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        if self.left.is_empty() && self.count > 1 {
            (self.left, self.count) = (self.line, self.count - 1);
        }
        self.left.read(into)
    }
}

/// Comments are read through; vertices and faces end the reading where there are too many.
#[test]
fn two_gigabytes_are_streamed_or_refused() {
    const COMMENT: &[u8] = &{
        let mut line = [b'#'; 4096];
        line[4095] = b'\n';
        line
    };
    for (line, expected, most) in [
        (COMMENT, "no triangles", MAX_BYTES),
        (b"v 1 2 3\nv 2 3 4\nv 4 5 7\n" as &[u8], "more than 33554432 vertices", 2 << 30),
    ] {
        let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let (loaded, bytes) = peak::measure(|| load_from(&Endless(line), "a.obj", &LoadOptions::default()));
        let error = loaded.expect_err("nothing to draw").to_string();
        println!("{bytes} bytes at most: {error}");
        assert!(error.contains(expected) && error.contains("\nhelp: "), "{error}");
        assert!(bytes < most, "{bytes} bytes");
    }
}
#[test]
fn files_and_lines_beyond_the_limits_are_refused() {
    let long_line = format!("v 0 0 0\n#{}\n", "x".repeat(2 << 20));
    let source = Memory::from_iter([("a.obj", long_line)]);
    let error = load_from(&source, "a.obj", &LoadOptions::default()).expect_err("too long").to_string();
    assert!(error.starts_with("a.obj:2: the line has 1048576 bytes or more\nhelp: "), "{error}");

    let source = scene_with(&png(1, 1));
    let options = LoadOptions { max_file_bytes: 20, ..LoadOptions::default() };
    let error = load_from(&source, "a.obj", &options).expect_err("too large").to_string();
    assert!(error.contains("the limit is 20\nhelp: raise `--max-size`"), "{error}");
}

#[test]
fn a_file_may_not_open_any_number_of_libraries() {
    let mut obj = String::from("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    (0..50_000).for_each(|index| obj.push_str(&format!("mtllib {index}.mtl\nmtllib 0.mtl\n")));
    let source = Memory::from_iter([("a.obj", &obj)]);
    let loaded = cheaply("libraries", || load_from(&source, "a.obj", &LoadOptions::default())).expect("loads");
    let warnings: Vec<_> = loaded.warnings.iter().map(ToString::to_string).collect();
    let expected =
        "a.obj:517: material libraries beyond the 256th are not opened (49744 in all, the first on this line)";
    assert!(warnings.iter().any(|warning| warning == expected), "{:?}", &warnings[..3]);
}
