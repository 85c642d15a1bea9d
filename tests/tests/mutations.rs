//! Files of `tests/corpus` and images made here, changed at random: nothing panics, and memory stays in proportion.
//!
//! Runs a fixed number of changes, the same each time; `WEIR_FUZZ_SECONDS=600` runs for as long as that instead. A failure
//! writes the files to the temporary folder and says where.

mod peak;

use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use exr::prelude::WritableImage;
use image::{DynamicImage, ImageBuffer, ImageFormat, Rgb};
use weir::scene::error::SceneError;
use weir::scene::load::{LoadOptions, load_from};
use weir::scene::source::Memory;
use weir::scene::{camera, environment};

/// Cases in a run without a time limit.
const CASES: u64 = 150_000;

/// What a case may use beside eight times its input.
const MAX_BYTES: usize = 64 << 20;

/// Numbers and words at which parsers change their mind.
const TOKENS: [&[u8]; 40] = [
    b"0",
    b"-1",
    b"1",
    b"-0",
    b"4294967295",
    b"4294967296",
    b"-2147483649",
    b"9223372036854775807",
    b"-9223372036854775808",
    b"18446744073709551616",
    b"nan",
    b"-inf",
    b"1e39",
    b"1e-46",
    b"1e308",
    b"0x1p3",
    b"/",
    b"//",
    b"\\\n",
    b"\r",
    b"\n",
    b"\t",
    b" ",
    b"#",
    b"\"",
    b"\xEF\xBB\xBF",
    b"\xff\xfe",
    b"\0",
    b"f ",
    b"v ",
    b"vt ",
    b"vn ",
    b"usemtl ",
    b"mtllib ",
    b"newmtl ",
    b"Kd ",
    b"map_Kd ",
    b"illum ",
    b"-s 1 1 1 ",
    b"d ",
];

/// What a file is, and so what reads it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Obj,
    Mtl,
    Texture,
    Environment,
    Camera,
}

fn seeds() -> Vec<(Kind, Vec<u8>)> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let mut paths: Vec<_> = corpus.read_dir().expect("a folder").flatten().map(|entry| entry.path()).collect();
    paths.sort();
    let mut seeds = Vec::new();
    for path in paths {
        let kind = match path.extension().and_then(|extension| extension.to_str()) {
            Some("obj") => Kind::Obj,
            Some("mtl") => Kind::Mtl,
            Some("png") => Kind::Texture,
            _ => continue,
        };
        seeds.push((kind, std::fs::read(path).expect("readable")));
    }
    let encoded = |image: DynamicImage, format| {
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, format).expect("memory");
        file.into_inner()
    };
    let picture = DynamicImage::from(ImageBuffer::from_fn(24, 16, |x, y| Rgb([x as u8 * 9, y as u8 * 15, 40_u8])));
    seeds.push((Kind::Texture, encoded(picture.clone(), ImageFormat::Png)));
    seeds.push((Kind::Texture, encoded(picture.clone(), ImageFormat::Jpeg)));
    seeds.push((Kind::Texture, encoded(picture.to_rgba16().into(), ImageFormat::Png)));
    seeds.push((Kind::Environment, encoded(picture.to_rgb32f().into(), ImageFormat::Hdr)));
    use exr::image::{Encoding, Image, Layer, SpecificChannels};
    use exr::prelude::LayerAttributes;
    for encoding in
        [Encoding::FAST_LOSSLESS, Encoding::SMALL_LOSSLESS, Encoding::SMALL_FAST_LOSSLESS, Encoding::UNCOMPRESSED]
    {
        let pixel = |at: exr::math::Vec2<usize>| (at.x() as f32, at.y() as f32, 0.5_f32);
        let layer = Layer::new((24, 16), LayerAttributes::default(), encoding, SpecificChannels::rgb(pixel));
        let mut file = Cursor::new(Vec::new());
        Image::from_layer(layer).write().to_buffered(&mut file).expect("memory");
        seeds.push((Kind::Environment, file.into_inner()));
    }
    let camera =
        br#"{"camera": {"origin": [1, 2, 3], "target": [0, 0, 0], "up": [0, 1, 0], "vfov_deg": 40, "width": 7}}"#;
    seeds.push((Kind::Camera, camera.to_vec()));
    seeds
}

/// Source: Vigna 2014, xorshift64*.
struct Rng(u64);

impl Rng {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 16
    }

    fn below(&mut self, bound: usize) -> usize {
        self.next() as usize % bound.max(1)
    }
}

fn mutate(file: &mut Vec<u8>, other: &[u8], rng: &mut Rng) {
    for _ in 0..=rng.below(4) {
        let at = rng.below(file.len() + 1);
        let end = (at + 1 + rng.below(16)).min(file.len());
        match rng.below(8) {
            0 if at < file.len() => file[at] ^= 1 << rng.below(8),
            1 if at < file.len() => file[at] = rng.next() as u8,
            2 => _ = file.drain(at..end),
            3 => {
                let piece = file[at..end].to_vec();
                file.splice(at..at, piece);
            }
            4 => _ = file.splice(at..end, TOKENS[rng.below(TOKENS.len())].iter().copied()),
            5 => _ = file.splice(at..at, TOKENS[rng.below(TOKENS.len())].iter().copied()),
            6 => {
                let from = rng.below(other.len());
                let piece = &other[from..(from + 1 + rng.below(64)).min(other.len())];
                file.splice(at..at, piece.iter().copied());
            }
            _ => file.truncate(at.max(file.len() / 2)),
        }
    }
}

/// Reads `file` as what it is; `Err` with what a reader may never say.
fn read(kind: Kind, file: &[u8]) -> Result<(), String> {
    const OBJ: &[u8] = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\nusemtl n\nf 3 2 1\n";
    const MTL: &[u8] = b"newmtl m\nmap_Kd t.png\nmap_d t.png\nnewmtl n\nKd 1\n";
    let (obj, mtl) = match kind {
        Kind::Obj => (file, MTL),
        Kind::Mtl => (OBJ, file),
        _ => (OBJ, MTL),
    };
    let texture = if kind == Kind::Texture { file } else { b"none" };
    let error = match kind {
        Kind::Environment => environment::decode(file, "e", 0.0, 1.0).err(),
        Kind::Camera => camera::parse(file, "c.json").err(),
        _ => {
            let source = Memory::from_iter([("a.obj", obj), ("a.mtl", mtl), ("t.png", texture)]);
            load_from(&source, "a.obj", &LoadOptions::default()).err()
        }
    };
    match error {
        Some(SceneError::Invalid { what, .. }) => Err(format!("an unsound scene: {what}")),
        Some(error) if !error.to_string().contains("\nhelp: ") => Err(format!("no help: {error}")),
        _ => Ok(()),
    }
}

/// The panics of decoders are caught where they are called; here they are counted all the same.
static PANICS: Mutex<Vec<String>> = Mutex::new(Vec::new());

#[test]
fn damaged_files_are_read_or_refused_in_good_order() {
    std::panic::set_hook(Box::new(|info| PANICS.lock().expect("not poisoned").push(info.to_string())));
    let seconds = std::env::var("WEIR_FUZZ_SECONDS").ok().and_then(|seconds| seconds.parse().ok());
    let time_limit = seconds.map(Duration::from_secs);
    let seeds = seeds();
    let start = Instant::now();
    let mut rng = Rng(0x5EED_0000_0000_0001);
    let mut cases = 0_u64;
    let mut most_bytes = 0;
    let mut failures = Vec::new();
    while time_limit.map_or(cases < CASES, |limit| start.elapsed() < limit) && failures.len() < 10 {
        let (kind, mut file) = seeds[rng.below(seeds.len())].clone();
        let (_, other) = &seeds[rng.below(seeds.len())];
        mutate(&mut file, other, &mut rng);
        let (result, bytes) = peak::measure(|| catch_unwind(AssertUnwindSafe(|| read(kind, &file))));
        most_bytes = most_bytes.max(bytes);
        cases += 1;
        let mut problems: Vec<String> = std::mem::take(&mut PANICS.lock().expect("not poisoned"));
        problems.extend(result.unwrap_or(Ok(())).err());
        if bytes > 8 * file.len() + MAX_BYTES {
            problems.push(format!("{bytes} bytes for {} bytes of input", file.len()));
        }
        if !problems.is_empty() {
            let path = std::env::temp_dir().join(format!("weir-mutation-{cases}"));
            std::fs::write(&path, &file).expect("writable");
            failures.push(format!("{kind:?}, {}: {}", path.display(), problems.join("; ")));
        }
    }
    _ = std::panic::take_hook();
    println!("{cases} cases in {:?}, at most {most_bytes} bytes", start.elapsed());
    assert!(failures.is_empty(), "{failures:#?}");
}
