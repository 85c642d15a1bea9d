//! Reading OpenEXR, without trust in what the file says of itself.

use std::fs::{self, File};
use std::io::{self, Cursor, Read as _};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use ::exr::image::read::read as reader;
use ::exr::meta::header::Header;
use ::exr::meta::{BlockDescription, MetaData};
use ::exr::prelude::{AnyChannels, FlatSamples, Layer, ReadChannels as _, ReadLayers as _};
use thiserror::Error;

use crate::exit::{Exit, HasExit};
use crate::output::Picture;

/// Largest width and height of a picture, and largest side of a tile.
const MAX_SIDE: usize = 16384;
/// Largest file, in bytes.
const MAX_FILE: u64 = 4 << 30;
/// Most bytes of pixels, all parts of a file together, decoded.
const MAX_DECODED: u64 = 4 << 30;
/// Decoded bytes that any file may have, however small it is.
const FREE_DECODED: u64 = 16 << 20;
/// Decoded bytes that each byte of a file can stand for. DEFLATE reaches 1032, the other lossless methods less.
const MAX_RATIO: u64 = 1200;

/// A channel that is not part of the [`Picture`].
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Full name, `Albedo.R` for one.
    pub name: String,
    /// One value a pixel, row by row, the top row first.
    pub samples: Samples,
}

/// The values of a [`Channel`].
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// 32-bit floats, or 16-bit ones widened.
    Float(Vec<f32>),
    /// Unsigned integers.
    Uint(Vec<u32>),
}

/// Why a picture was not read.
#[derive(Debug, Error)]
pub enum ReadError {
    /// The file does not exist, or may not be opened.
    #[error("cannot open the picture ({source}); check its name and permissions: {}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A directory, a device or the like.
    #[error("the picture is not a regular file; name an .exr file: {}", path.display())]
    NotAFile {
        /// What was named.
        path: PathBuf,
    },
    /// Reading failed on the way.
    #[error("cannot read the picture ({source}); check the disk: {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The content cannot be used.
    #[error("{problem}: {}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: Problem,
    },
}

/// What is wrong with the content of an EXR file.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum Problem {
    /// Another format.
    #[error("this is not an OpenEXR file; convert it to EXR first")]
    NotExr,
    /// Cut off, damaged, or of a kind that is not supported.
    #[error("the EXR file is damaged or of an unsupported kind ({0}); save it again as flat scan lines with ZIP")]
    Damaged(String),
    /// More pixels or bytes than are accepted.
    #[error("{0} is beyond the limit of {1}; crop the picture or make it smaller")]
    TooLarge(String, String),
    /// The header promises more than the file can hold.
    #[error(
        "the header promises {promised} bytes of {what}, but the file has only {bytes} bytes; it is cut off or forged"
    )]
    Implausible {
        /// What there is too much of.
        what: &'static str,
        /// How many bytes of it.
        promised: u64,
        /// Size of the file.
        bytes: u64,
    },
    /// No layer has colors.
    #[error("no layer has the channels `R`, `G` and `B` (found: {0}); save the picture as RGB")]
    NoRgb(String),
}

impl HasExit for ReadError {
    fn exit(&self) -> Exit {
        match self {
            Self::Open { .. } | Self::NotAFile { .. } => Exit::NoInput,
            Self::Io { source, .. } => source.exit(),
            Self::Content { .. } => Exit::BadData,
        }
    }
}

/// Reads the first layer that has `R`, `G` and `B`, and whatever other channels that layer has.
///
/// The picture is the data window; where that is in the display window does not matter. Values are as stored, be they
/// negative or not a number. Memory stays within a constant times the size of the file, whatever its header says.
///
/// # Errors
///
/// The file cannot be opened or read, is no EXR, is damaged, is larger than 16384 pixels a side, or has no RGB.
pub fn read(path: &Path) -> Result<(Picture, Vec<Channel>), ReadError> {
    let open = |source| ReadError::Open { path: path.into(), source };
    let content = |problem| ReadError::Content { path: path.into(), problem };

    // Before opening: a FIFO would wait for a writer.
    if !fs::metadata(path).map_err(open)?.is_file() {
        return Err(ReadError::NotAFile { path: path.into() });
    }
    let mut bytes = Vec::new();
    File::open(path)
        .map_err(open)?
        .take(MAX_FILE + 1)
        .read_to_end(&mut bytes)
        .map_err(|source| ReadError::Io { path: path.into(), source })?;
    if bytes.len() as u64 > MAX_FILE {
        return Err(content(Problem::TooLarge("the file".into(), format!("{MAX_FILE} bytes"))));
    }
    decode(&bytes).map_err(content)
}

/// Reads an EXR file that is in memory.
pub(super) fn decode(bytes: &[u8]) -> Result<(Picture, Vec<Channel>), Problem> {
    // A bug of the decoder on damaged input is the input's fault as far as the caller is concerned.
    catch_unwind(AssertUnwindSafe(|| decode_unguarded(bytes)))
        .unwrap_or_else(|_| Err(Problem::Damaged("the decoder failed".into())))
}

fn decode_unguarded(bytes: &[u8]) -> Result<(Picture, Vec<Channel>), Problem> {
    let damaged = |error: ::exr::error::Error| Problem::Damaged(error.to_string());
    if !bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        return Err(Problem::NotExr);
    }
    let meta = MetaData::read_from_buffered(bytes, false).map_err(damaged)?;
    check_plausible(&meta.headers, bytes.len() as u64)?;

    let image = reader()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(damaged)?;
    let mut found = Vec::new();
    for layer in image.layer_data {
        let names: Vec<String> = layer.channel_data.list.iter().map(|channel| channel.name.to_string()).collect();
        if ["R", "G", "B"].iter().all(|wanted| names.iter().any(|name| name == wanted)) {
            return split(layer);
        }
        found.extend(names);
    }
    Err(Problem::NoRgb(found.join(", ")))
}

/// Compares what the headers promise with the size of the file, before anything of that size is allocated.
fn check_plausible(headers: &[Header], bytes: u64) -> Result<(), Problem> {
    let (mut table, mut decoded) = (0_u64, 0_u64);
    for header in headers {
        if header.deep {
            return Err(Problem::Damaged("deep data".into()));
        }
        let size = header.layer_size;
        let tile = match header.blocks {
            BlockDescription::Tiles(tiles) => tiles.tile_size,
            BlockDescription::ScanLines => size,
        };
        for (what, size) in [("a layer", size), ("a tile", tile)] {
            if size.0.max(size.1) > MAX_SIDE {
                let found = format!("{what} of {}x{} pixels", size.0, size.1);
                return Err(Problem::TooLarge(found, format!("{MAX_SIDE} a side")));
            }
        }
        // Each chunk has an 8-byte entry in the table, and at least 8 bytes of its own.
        table = table.saturating_add((header.chunk_count as u64).saturating_mul(16));
        // A tile is decoded whole, even where little of it lies inside the layer.
        let block = (tile.0 * tile.1).max(size.0 * size.1) as u64;
        decoded = decoded.saturating_add(block.saturating_mul(header.channels.bytes_per_pixel as u64));
    }
    if table > bytes {
        return Err(Problem::Implausible { what: "chunks", promised: table, bytes });
    }
    if decoded > FREE_DECODED.max(bytes.saturating_mul(MAX_RATIO)) {
        return Err(Problem::Implausible { what: "pixels", promised: decoded, bytes });
    }
    if decoded > MAX_DECODED {
        return Err(Problem::TooLarge(format!("{decoded} bytes of pixels"), format!("{MAX_DECODED} bytes")));
    }
    Ok(())
}

/// Takes a layer apart into the picture and the other channels.
fn split(layer: Layer<AnyChannels<FlatSamples>>) -> Result<(Picture, Vec<Channel>), Problem> {
    let pixels = layer.size.area();
    let mut rgb = vec![[0.0; 3]; pixels];
    let mut alpha = None;
    let mut channels = Vec::new();
    for channel in layer.channel_data.list {
        if channel.sample_data.len() != pixels {
            return Err(Problem::Damaged(format!("channel `{}` is subsampled", channel.name)));
        }
        let name = channel.name.to_string();
        match name.as_str() {
            "R" | "G" | "B" => {
                let component = match name.as_str() {
                    "R" => 0,
                    "G" => 1,
                    _ => 2,
                };
                for (value, sample) in rgb.iter_mut().zip(channel.sample_data.values_as_f32()) {
                    value[component] = sample;
                }
            }
            "A" => alpha = Some(channel.sample_data.values_as_f32().collect()),
            _ => channels.push(Channel { name, samples: samples(channel.sample_data) }),
        }
    }
    // Within MAX_SIDE, so the casts are exact.
    Ok((Picture { width: layer.size.0 as u32, height: layer.size.1 as u32, rgb, alpha }, channels))
}

fn samples(samples: FlatSamples) -> Samples {
    match samples {
        FlatSamples::U32(values) => Samples::Uint(values),
        FlatSamples::F32(values) => Samples::Float(values),
        FlatSamples::F16(values) => Samples::Float(values.into_iter().map(f32::from).collect()),
    }
}

#[cfg(test)]
mod tests {
    use ::exr::prelude::{
        AnyChannel, Compression, Encoding, Image, LayerAttributes, SmallVec, WritableImage as _, f16,
    };

    use super::*;

    fn file(size: (usize, usize), encoding: Encoding, names: &[&str]) -> Vec<u8> {
        let half = |i: usize| f16::from_f32(i as f32 / 4.0);
        let samples = FlatSamples::F16((0..size.0 * size.1).map(half).collect());
        let list: SmallVec<_> = names.iter().map(|name| AnyChannel::new(*name, samples.clone())).collect();
        let layer = Layer::new(size, LayerAttributes::named("x"), encoding, AnyChannels::sort(list));
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().to_buffered(&mut bytes).expect("encodes");
        bytes.into_inner()
    }

    /// Finds an attribute's value by name and type.
    fn value_at(file: &[u8], name_and_type: &[u8]) -> usize {
        let found = file.windows(name_and_type.len()).position(|window| window == name_and_type);
        found.expect("the attribute is there") + name_and_type.len() + 4
    }

    #[test]
    fn half_floats_are_widened_in_every_lossless_compression_and_in_tiles() {
        let compressions = [
            Compression::Uncompressed,
            Compression::RLE,
            Compression::ZIP1,
            Compression::ZIP16,
            Compression::PIZ,
            Compression::PXR24,
        ];
        for compression in compressions {
            for blocks in [Encoding::SMALL_LOSSLESS.blocks, Encoding::FAST_LOSSLESS.blocks] {
                let encoding = Encoding { compression, blocks, ..Encoding::SMALL_LOSSLESS };
                let bytes = file((5, 3), encoding, &["B", "G", "R", "extra"]);
                let (picture, channels) = decode(&bytes).expect("decodes");
                assert_eq!((picture.width, picture.height, picture.rgb.len()), (5, 3, 15));
                assert_eq!(picture.rgb[7], [1.75; 3], "{encoding:?}");
                assert_eq!(channels.len(), 1);
            }
        }
    }

    #[test]
    fn a_file_without_colors_says_what_it_has() {
        let problem = decode(&file((2, 2), Encoding::SMALL_LOSSLESS, &["Y", "Z"])).expect_err("no RGB");
        assert_eq!(problem, Problem::NoRgb("Y, Z".into()));
    }

    #[test]
    fn another_format_is_named_as_such() {
        assert_eq!(decode(b"\x89PNG\r\n\x1a\n"), Err(Problem::NotExr));
        assert_eq!(decode(b""), Err(Problem::NotExr));
    }

    #[test]
    fn a_file_cut_off_anywhere_is_refused() {
        let bytes = file((5, 3), Encoding::SMALL_LOSSLESS, &["B", "G", "R"]);
        for length in 0..bytes.len() {
            assert!(decode(&bytes[..length]).is_err(), "{length} of {} bytes", bytes.len());
        }
    }

    #[test]
    fn a_header_that_promises_more_than_the_file_holds_is_refused() {
        let mut bytes = file((5, 3), Encoding::UNCOMPRESSED, &["B", "G", "R"]);
        let at = value_at(&bytes, b"dataWindow\0box2i\0");
        bytes[at + 8..at + 16].copy_from_slice(&[16383_i32.to_le_bytes(); 2].concat());
        // Room for the table of 16384 lines, so that only the pixels are too many.
        bytes.resize(bytes.len() + 16 * 16384, 0);
        let problem = decode(&bytes).expect_err("forged");
        assert!(matches!(problem, Problem::Implausible { what: "pixels", .. }), "{problem:?}");
    }

    #[test]
    fn more_chunks_than_the_file_has_room_for_are_refused() {
        let mut bytes = file((5, 3), Encoding::UNCOMPRESSED, &["B", "G", "R"]);
        let at = value_at(&bytes, b"dataWindow\0box2i\0");
        bytes[at + 12..at + 16].copy_from_slice(&16383_i32.to_le_bytes());
        let problem = decode(&bytes).expect_err("forged");
        assert!(matches!(problem, Problem::Implausible { what: "chunks", .. }), "{problem:?}");
    }

    #[test]
    fn a_huge_layer_or_tile_is_refused() {
        let mut bytes = file((5, 3), Encoding::UNCOMPRESSED, &["B", "G", "R"]);
        let at = value_at(&bytes, b"dataWindow\0box2i\0");
        bytes[at + 8..at + 12].copy_from_slice(&16384_i32.to_le_bytes());
        assert!(matches!(decode(&bytes), Err(Problem::TooLarge(..))));

        let mut bytes = file((5, 3), Encoding::FAST_LOSSLESS, &["B", "G", "R"]);
        let at = value_at(&bytes, b"tiles\0tiledesc\0");
        bytes[at..at + 4].copy_from_slice(&1_000_000_u32.to_le_bytes());
        assert!(matches!(decode(&bytes), Err(Problem::TooLarge(..))));
    }

    /// Every byte of a small file is damaged in turn. What comes back is an error or a picture of a plausible size.
    #[test]
    fn no_damaged_byte_brings_the_reader_down() {
        for encoding in [Encoding::SMALL_LOSSLESS, Encoding::FAST_LOSSLESS, Encoding::UNCOMPRESSED] {
            let good = file((5, 3), encoding, &["B", "G", "R"]);
            let mut errors = 0;
            for index in 0..good.len() {
                for flip in [0x01, 0x80, 0xff] {
                    let mut bytes = good.clone();
                    bytes[index] ^= flip;
                    match decode_unguarded(&bytes) {
                        Ok((picture, _)) => assert!(picture.rgb.len() as u64 * 6 <= FREE_DECODED),
                        Err(_) => errors += 1,
                    }
                }
            }
            assert!(errors > good.len() / 2, "damage goes unnoticed: {errors} errors");
        }
    }
}
