//! Environment maps: Radiance HDR and OpenEXR files to linear radiance, within limits.

use std::io::Cursor;
use std::panic::catch_unwind;
use std::path::Path;

use exr::math::Vec2 as ExrVec2;
use exr::meta::header::Header;
use exr::prelude::{ReadChannels, ReadLayers, ReadSpecificChannel};
use image::{ImageDecoder, ImageFormat, ImageReader};

use super::Environment;
use super::error::{Place, SceneError, Warning, Warnings};
use super::keywords::MAX_RADIANCE;
use super::source::{Directory, Source};
use super::texture::{check_size, limits_before_size};

/// Wider maps are reduced: lights that small are below what sampling resolves.
pub const MAX_WIDTH: u32 = 4096;

/// Largest file accepted, in bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;

const HELP: &str = "use an equirectangular .hdr or .exr file with RGB channels, at most 9000 pixels wide";

/// Reads the map at `path`.
///
/// `rotation_deg` turns it about +y, counter-clockwise seen from above; `scale` multiplies its radiance.
///
/// # Errors
/// When the file is missing or cannot be decoded within the limits, or a parameter is out of range.
pub fn load(path: &Path, rotation_deg: f32, scale: f32) -> Result<(Environment, Vec<Warning>), SceneError> {
    let shown = path.display().to_string();
    let (directory, name) = Directory::of_scene(path, None)?;
    let opened = directory.open(&name).map_err(|error| SceneError::no_input(&shown, error.to_string(), HELP))?;
    let contents =
        opened.read(MAX_FILE_BYTES).map_err(|error| SceneError::no_input(&shown, error.to_string(), HELP))?;
    decode(&contents, &shown, rotation_deg, scale)
}

/// Decodes the contents of a file that messages call `name`; see [`load`].
///
/// # Errors
/// When the contents cannot be decoded within the limits, or a parameter is out of range.
pub fn decode(
    contents: &[u8],
    name: &str,
    rotation_deg: f32,
    scale: f32,
) -> Result<(Environment, Vec<Warning>), SceneError> {
    let place = Place::new(name, 0);
    if !(rotation_deg.is_finite() && scale.is_finite() && scale >= 0.0) {
        let what = format!("rotation {rotation_deg} or scale {scale} is out of range");
        return Err(SceneError::bad_data(place, what, "give a finite rotation, and a scale of 0 or more"));
    }
    let pixels = catch_unwind(|| match contents {
        [0x76, 0x2f, 0x31, 0x01, ..] => decode_exr(contents),
        [b'#', b'?', ..] => decode_hdr(contents),
        _ => Err("this is neither a Radiance HDR nor an OpenEXR file".to_owned()),
    });
    let pixels = pixels.unwrap_or_else(|_| Err("the decoder failed".to_owned()));
    let pixels = pixels.map_err(|reason| SceneError::bad_data(place.clone(), reason, HELP))?;

    let Pixels { mut width, mut height, mut texels } = pixels;
    let mut warnings = Warnings::default();
    let (mut not_radiance, mut too_bright) = (0, 0);
    for channel in texels.as_flattened_mut() {
        if channel.is_nan() || channel.is_infinite() || *channel < 0.0 {
            *channel = 0.0;
            not_radiance += 1;
        } else if *channel > MAX_RADIANCE as f32 {
            *channel = MAX_RADIANCE as f32;
            too_bright += 1;
        }
    }
    warnings.push_count(place.clone(), not_radiance, |count| {
        format!("values that are negative or not finite, replaced by 0: {count}")
    });
    warnings.push_count(place.clone(), too_bright, |count| format!("values above 1e20, reduced to it: {count}"));
    if width > MAX_WIDTH {
        let before = (width, height);
        (width, height, texels) = reduce(width, height, &texels);
        let message = format!("the map was reduced from {}x{} to {width}x{height} pixels", before.0, before.1);
        warnings.push(place, message);
    }
    let name = name.to_owned();
    Ok((Environment { name, width, height, texels, rotation_deg, scale }, warnings.into_vec()))
}

/// A decoded image.
struct Pixels {
    width: u32,
    height: u32,
    texels: Vec<[f32; 3]>,
}

impl Pixels {
    fn black(size: ExrVec2<usize>) -> Self {
        Self { width: size.width() as u32, height: size.height() as u32, texels: vec![[0.0; 3]; size.area()] }
    }

    fn set(&mut self, at: ExrVec2<usize>, rgb: [f32; 3]) {
        self.texels[at.y() * self.width as usize + at.x()] = rgb;
    }
}

fn decode_hdr(contents: &[u8]) -> Result<Pixels, String> {
    let reader = || {
        let mut reader = ImageReader::with_format(Cursor::new(contents), ImageFormat::Hdr);
        reader.limits(limits_before_size());
        reader
    };
    let decoder = reader().into_decoder().map_err(|error| error.to_string())?;
    // 127 pixels in 8 bytes at best.
    check_size(decoder.dimensions(), decoder.total_bytes(), contents.len(), 192)?;
    let image = reader().decode().map_err(|error| error.to_string())?.into_rgb32f();
    let (width, height) = image.dimensions();
    let texels = image.into_raw().chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect();
    Ok(Pixels { width, height, texels })
}

fn decode_exr(contents: &[u8]) -> Result<Pixels, String> {
    let describe = |error: exr::error::Error| error.to_string();
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(contents), false).map_err(describe)?;
    for header in &meta.headers {
        check_exr_header(header, contents.len())?;
    }
    let has = |name: &str| {
        let named = |channel: &exr::meta::attribute::ChannelDescription| channel.name.eq(name);
        meta.headers.iter().any(|header| header.channels.list.iter().any(named))
    };

    let levels = exr::prelude::read().no_deep_data().largest_resolution_level();
    if has("R") && has("G") && has("B") {
        let image = levels
            .rgb_channels(
                |size, _| Pixels::black(size),
                |pixels: &mut Pixels, at, (red, green, blue): (f32, f32, f32)| pixels.set(at, [red, green, blue]),
            )
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(contents));
        Ok(image.map_err(describe)?.layer_data.channel_data.pixels)
    } else if has("Y") {
        let image = levels
            .specific_channels()
            .required("Y")
            .collect_pixels(
                |size, _| Pixels::black(size),
                |pixels: &mut Pixels, at, (luminance,): (f32,)| pixels.set(at, [luminance; 3]),
            )
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(contents));
        Ok(image.map_err(describe)?.layer_data.channel_data.pixels)
    } else {
        let names = meta.headers.iter().flat_map(|header| &header.channels.list).take(8);
        let names: Vec<_> = names.map(|channel| format!("`{}`", channel.name)).collect();
        Err(format!("it has the channels {}, but no `R`, `G` and `B`", names.join(", ")))
    }
}

/// Refuses headers that would make the decoder reserve more memory than a file of `file_bytes` justifies.
///
/// The decoder reserves whole blocks before it reads them, and takes their size from the header.
fn check_exr_header(header: &Header, file_bytes: usize) -> Result<(), String> {
    const SMALL_BLOCK_BYTES: u64 = 4 << 20;
    if header.deep {
        return Err("deep images are not supported".to_owned());
    }
    let (Ok(width), Ok(height)) = (u32::try_from(header.layer_size.width()), u32::try_from(header.layer_size.height()))
    else {
        return Err("its size is out of range".to_owned());
    };
    let texels = u64::from(width) * u64::from(height);
    let channel_bytes = header.channels.list.iter().map(|channel| channel.sample_type.bytes_per_sample() as u64);
    // As stored, with a third for smaller levels, or as three f32, whichever is more.
    let stored_bytes = texels.saturating_mul(channel_bytes.sum::<u64>()).saturating_mul(4) / 3;
    check_size((width, height), stored_bytes.max(12 * texels), file_bytes, 256)?;
    let block_bytes = match header.blocks {
        exr::meta::BlockDescription::Tiles(tiles) => {
            let area = (tiles.tile_size.width() as u64).saturating_mul(tiles.tile_size.height() as u64);
            area.saturating_mul(header.channels.bytes_per_pixel as u64)
        }
        exr::meta::BlockDescription::ScanLines => stored_bytes.min(SMALL_BLOCK_BYTES),
    };
    if block_bytes > SMALL_BLOCK_BYTES.max(stored_bytes) {
        return Err(format!("its tiles of {block_bytes} bytes are larger than the image"));
    }
    // Each block has an 8-byte entry in a table.
    if header.chunk_count as u64 > file_bytes as u64 / 8 {
        return Err(format!("{} blocks cannot be in a file of {file_bytes} bytes", header.chunk_count));
    }
    Ok(())
}

/// Averages blocks of texels, so that the result is at most [`MAX_WIDTH`] wide.
fn reduce(width: u32, height: u32, texels: &[[f32; 3]]) -> (u32, u32, Vec<[f32; 3]>) {
    let step = width.div_ceil(MAX_WIDTH);
    let (new_width, new_height) = (width.div_ceil(step), height.div_ceil(step));
    let mut reduced = Vec::with_capacity(new_width as usize * new_height as usize);
    for y in 0..new_height {
        for x in 0..new_width {
            // Blocks at the right and lower edge may be smaller.
            let columns = x * step..((x + 1) * step).min(width);
            let rows = y * step..((y + 1) * step).min(height);
            let count = f64::from((columns.end - columns.start) * (rows.end - rows.start));
            let mut sum = [0.0_f64; 3];
            for row in rows {
                let start = row as usize * width as usize;
                for texel in &texels[start + columns.start as usize..start + columns.end as usize] {
                    (0..3).for_each(|channel| sum[channel] += f64::from(texel[channel]));
                }
            }
            reduced.push(sum.map(|sum| (sum / count) as f32));
        }
    }
    (new_width, new_height, reduced)
}
