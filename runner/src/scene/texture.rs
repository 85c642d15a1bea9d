//! Textures: PNG and JPEG files to 8-bit texels, each file once, within limits.

use std::collections::HashMap;
use std::io::Cursor;
use std::panic::catch_unwind;

use image::{ColorType, DynamicImage, ExtendedColorType, ImageDecoder, ImageFormat, ImageReader, Limits};
use rayon::prelude::*;

use super::Texture;
use super::downscale;
use super::error::{Place, Warnings};
use super::source::{Source, locate};

/// Largest width and height accepted, in texels.
pub const MAX_SIDE: u32 = 16384;

/// The most bytes of decoded images in memory at a time, before they are reduced to their final size.
pub const MAX_DECODED_BYTES: u64 = 512 << 20;

/// What a texture is used for; the same file may be used for both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Colours, sRGB-encoded.
    Color,
    /// A mask, linear, in the red channel: the alpha of the image where it has any, its red channel otherwise.
    Mask,
}

/// Collects the textures that materials ask for, then reads them all.
pub struct Textures<'a> {
    source: &'a dyn Source,
    max_file_bytes: u64,
    requests: Vec<Request>,
    by_name: HashMap<(String, Kind), Option<usize>>,
    by_key: HashMap<(String, Kind), usize>,
}

struct Request {
    name: String,
    path: String,
    kind: Kind,
    /// The material that asked first.
    place: Place,
}

/// A file that is known to be an image of acceptable size.
struct Inspected {
    contents: Vec<u8>,
    digest: blake3::Hash,
    format: ImageFormat,
    size: (u32, u32),
    decoded_bytes: u64,
    note: Option<&'static str>,
}

impl<'a> Textures<'a> {
    /// None yet.
    pub fn new(source: &'a dyn Source, max_file_bytes: u64) -> Self {
        Self { source, max_file_bytes, requests: Vec::new(), by_name: HashMap::new(), by_key: HashMap::new() }
    }

    /// Asks for the file that a library in `folder` calls `name`; returns what stands for it in [`Self::read`].
    pub fn request(
        &mut self,
        folder: &str,
        name: &str,
        kind: Kind,
        place: &Place,
        warnings: &mut Warnings,
    ) -> Option<usize> {
        let known_as = (format!("{folder}\n{name}"), kind);
        if let Some(&known) = self.by_name.get(&known_as) {
            return known;
        }
        let number = match locate(self.source, folder, name) {
            Ok(located) => {
                if let Some(reason) = located.replaced {
                    let message = format!("texture `{name}`: {reason}; `{}` is used in its place", located.name);
                    warnings.push(place.clone(), message);
                }
                let next = self.requests.len();
                let number = *self.by_key.entry((located.file.key, kind)).or_insert(next);
                if number == next {
                    let (name, path, place) = (located.name, located.file.path, place.clone());
                    self.requests.push(Request { name, path, kind, place });
                }
                Some(number)
            }
            Err(reason) => {
                warnings.push(place.clone(), format!("texture `{name}` is left out: {reason}"));
                None
            }
        };
        self.by_name.insert(known_as, number);
        number
    }

    /// Reads what was asked for, and halves the largest until all fit `budget_bytes`.
    ///
    /// Returns the textures, and for each request the index of its texture, if it could be read. Files with equal
    /// contents share one.
    pub fn read(self, budget_bytes: u64, warnings: &mut Warnings) -> (Vec<Texture>, Vec<Option<u32>>) {
        let inspected: Vec<_> = self.requests.par_iter().with_max_len(1).map(|request| self.inspect(request)).collect();

        let mut unique: Vec<(&Request, Inspected)> = Vec::new();
        let mut by_digest = HashMap::new();
        let mut index_of_request = Vec::new();
        for (request, inspected) in self.requests.iter().zip(inspected) {
            index_of_request.push(match inspected {
                Ok(image) => {
                    let next = unique.len();
                    let index = *by_digest.entry((image.digest, request.kind)).or_insert(next);
                    if index == next {
                        if let Some(note) = image.note {
                            warnings.push(request.place.clone(), format!("texture `{}` {note}", request.path));
                        }
                        unique.push((request, image));
                    }
                    Some(index)
                }
                Err(reason) => {
                    let message = format!("texture `{}` is left out: {reason}", request.path);
                    warnings.push(request.place.clone(), message);
                    None
                }
            });
        }

        let sizes: Vec<_> = unique.iter().map(|(_, image)| image.size).collect();
        let halvings = downscale::plan(&sizes, budget_bytes);
        let reduced = halvings.iter().filter(|&&count| count > 0).count() as u64;
        if let Some((request, _)) = unique.first() {
            warnings.push_count(Place::new(&request.place.file, 0), reduced, |count| {
                format!("textures were reduced in size to fit the budget of {budget_bytes} bytes for all: {count}")
            });
        }

        let (textures, index_of_unique) = decode_all(unique.into_iter().zip(halvings), warnings);
        let index_of_request =
            index_of_request.into_iter().map(|index| index.and_then(|index: usize| index_of_unique[index]));
        (textures, index_of_request.collect())
    }

    /// Reads a file and its header, and refuses what is too large before any of it is decoded.
    fn inspect(&self, request: &Request) -> Result<Inspected, String> {
        let opened = self.source.open(&request.name).map_err(|error| error.to_string())?;
        let contents = opened.read(self.max_file_bytes).map_err(|error| error.to_string())?;
        let (format, size, decoded_bytes, note) = inspect_header(&contents)?;
        Ok(Inspected { digest: blake3::hash(&contents), contents, format, size, decoded_bytes, note })
    }
}

/// Limits on decoders; on top of [`check_size`], which knows the file.
pub(super) fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_DECODED_BYTES);
    limits
}

/// [`limits`] until the header is read: then [`check_size`] says more of the size than the decoder would.
pub(super) fn limits_before_size() -> Limits {
    let mut limits = limits();
    (limits.max_image_width, limits.max_image_height) = (None, None);
    limits
}

/// Refuses images whose header promises more than a file of `file_bytes` can hold.
///
/// `max_ratio` is how far the format can compress; small images are always accepted.
pub(super) fn check_size(
    size: (u32, u32),
    decoded_bytes: u64,
    file_bytes: usize,
    max_ratio: u64,
) -> Result<(), String> {
    const ALWAYS_ACCEPTED_BYTES: u64 = 16 << 20;
    let (width, height) = size;
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        return Err(format!("it has {width}x{height} pixels, the limit is {MAX_SIDE}x{MAX_SIDE}"));
    }
    if decoded_bytes > MAX_DECODED_BYTES {
        let (mib, limit) = (decoded_bytes >> 20, MAX_DECODED_BYTES >> 20);
        return Err(format!("{width}x{height} pixels need {mib} MiB, the limit is {limit} MiB"));
    }
    if decoded_bytes > ALWAYS_ACCEPTED_BYTES + max_ratio * file_bytes as u64 {
        return Err(format!("{width}x{height} pixels cannot be in a file of {file_bytes} bytes"));
    }
    Ok(())
}

type Header = (ImageFormat, (u32, u32), u64, Option<&'static str>);

fn inspect_header(contents: &[u8]) -> Result<Header, String> {
    let guarded = catch_unwind(|| {
        let mut reader = ImageReader::new(Cursor::new(contents)).with_guessed_format().map_err(|e| e.to_string())?;
        let format = match reader.format() {
            Some(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => format,
            _ => return Err("its format is not supported (PNG and JPEG are)".to_owned()),
        };
        reader.limits(limits_before_size());
        let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
        // Deflate reaches 1032:1.
        check_size(decoder.dimensions(), decoder.total_bytes(), contents.len(), 1100)?;
        let note = match decoder.original_color_type() {
            ExtendedColorType::Cmyk8 => Some("was converted from CMYK without a colour profile"),
            _ if decoder.color_type().bits_per_pixel() / u16::from(decoder.color_type().channel_count()) > 8 => {
                Some("was reduced from 16 to 8 bits a channel")
            }
            _ if format == ImageFormat::Png && is_animated(contents) => Some("is animated; its first frame is used"),
            _ => None,
        };
        let texel_bytes = 4 * u64::from(decoder.dimensions().0) * u64::from(decoder.dimensions().1);
        Ok((format, decoder.dimensions(), decoder.total_bytes() + texel_bytes, note))
    });
    guarded.unwrap_or_else(|_| Err("the decoder failed".to_owned()))
}

/// Whether a PNG file has an animation control chunk, which comes before the first image data.
fn is_animated(contents: &[u8]) -> bool {
    let head = &contents[..contents.len().min(4096)];
    let head = head.windows(4).position(|chunk| chunk == b"IDAT").map_or(head, |end| &head[..end]);
    head.windows(4).any(|chunk| chunk == b"acTL")
}

/// Decodes images, each with how often it has to be halved, a batch of limited size at a time.
///
/// Returns the textures, and for each image the index of its texture, if it could be decoded.
fn decode_all<'r>(
    images: impl Iterator<Item = ((&'r Request, Inspected), u32)>,
    warnings: &mut Warnings,
) -> (Vec<Texture>, Vec<Option<u32>>) {
    let mut textures = Vec::new();
    let mut index_of_unique = Vec::new();
    let mut rest = images.peekable();
    while rest.peek().is_some() {
        // As many as may be decoded at a time, and at least one.
        let mut batch = Vec::new();
        let mut bytes = 0;
        while let Some(next) =
            rest.next_if(|((_, image), _)| batch.is_empty() || bytes + image.decoded_bytes <= MAX_DECODED_BYTES)
        {
            bytes += next.0.1.decoded_bytes;
            batch.push(next);
        }
        let decoded: Vec<_> = batch
            .into_par_iter()
            .with_max_len(1)
            .map(|((request, image), halvings)| (request, decode(request, image, halvings)))
            .collect();
        for (request, texture) in decoded {
            index_of_unique.push(match texture {
                Ok(texture) => {
                    textures.push(texture);
                    Some(textures.len() as u32 - 1)
                }
                Err(reason) => {
                    let message = format!("texture `{}` is left out: {reason}", request.path);
                    warnings.push(request.place.clone(), message);
                    None
                }
            });
        }
    }
    (textures, index_of_unique)
}

fn decode(request: &Request, image: Inspected, halvings: u32) -> Result<Texture, String> {
    let guarded = catch_unwind(|| {
        let mut reader = ImageReader::with_format(Cursor::new(&image.contents), image.format);
        reader.limits(limits());
        reader.decode().map_err(|error| error.to_string())
    });
    let decoded = guarded.unwrap_or_else(|_| Err("the decoder failed".to_owned()))?;
    let (width, height) = (decoded.width(), decoded.height());
    let texels = texels(decoded, request.kind);
    let mut texture = Texture { name: request.path.clone(), width, height, srgb: request.kind == Kind::Color, texels };
    (0..halvings).for_each(|_| downscale::halve(&mut texture));
    Ok(texture)
}

fn texels(image: DynamicImage, kind: Kind) -> Vec<u32> {
    let has_alpha = image.color().has_alpha();
    let mut texels: Vec<u32> = if image.color() == ColorType::Rgb8 {
        let opaque = |rgb: &[u8]| u32::from_le_bytes([rgb[0], rgb[1], rgb[2], 255]);
        image.into_bytes().chunks_exact(3).map(opaque).collect()
    } else {
        let texel = |rgba: &[u8]| u32::from_le_bytes([rgba[0], rgba[1], rgba[2], rgba[3]]);
        image.into_rgba8().into_raw().chunks_exact(4).map(texel).collect()
    };
    if kind == Kind::Mask && has_alpha && texels.iter().any(|texel| texel >> 24 != 255) {
        texels.iter_mut().for_each(|texel| *texel = (*texel >> 24) * 0x0101_0101);
    }
    texels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_that_is_too_large_is_told_its_size_and_the_limit() {
        let mut file = Vec::new();
        let mut writer = png::Encoder::new(&mut file, 40_000, 40_000).write_header().expect("a header");
        writer.write_chunk(png::chunk::IDAT, &[]).expect("some data");
        drop(writer);
        let message = inspect_header(&file).map(drop).expect_err("it is too large");
        assert_eq!(message, "it has 40000x40000 pixels, the limit is 16384x16384");
    }
}
