//! PNG: 8 bits a channel, already display-encoded as sRGB.

use ::png::{BitDepth, ColorType, Encoder, EncodingError, SrgbRenderingIntent};

use super::{Destination, OutputError, atomic, check_shape};

/// Writes display-encoded pixels with an `sRGB` chunk.
///
/// `rgba8` holds red in the low byte, row by row, the top row first. Where every pixel is opaque the file has no alpha.
///
/// # Errors
///
/// The pixels don't match the size, or the destination cannot be written.
pub fn write(destination: &Destination, width: u32, height: u32, rgba8: &[u32]) -> Result<(), OutputError> {
    check_shape("RGBA", rgba8.len(), width, height)?;
    let bytes = encode(width, height, rgba8)
        .map_err(|error| OutputError::Encode { format: "PNG", reason: error.to_string() })?;
    atomic::write(destination, &bytes)
}

/// The bytes of such a file.
pub(crate) fn encode(width: u32, height: u32, rgba8: &[u32]) -> Result<Vec<u8>, EncodingError> {
    let opaque = rgba8.iter().all(|texel| texel >> 24 == 255);
    let (color, channels) = if opaque { (ColorType::Rgb, 3) } else { (ColorType::Rgba, 4) };
    let samples: Vec<u8> = rgba8.iter().flat_map(|texel| texel.to_le_bytes().into_iter().take(channels)).collect();

    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&samples)?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: u32 = 0xff00_00ff;
    const HALF_BLUE: u32 = 0x80ff_0000;

    #[test]
    fn an_independent_decoder_reads_the_same_pixels() {
        let bytes = encode(2, 1, &[RED, HALF_BLUE]).expect("encodes");
        let image = image::load_from_memory(&bytes).expect("decodes");
        assert_eq!(image.color(), image::ColorType::Rgba8);
        assert_eq!(image.to_rgba8().into_raw(), [255, 0, 0, 255, 0, 0, 255, 128]);
    }

    #[test]
    fn an_opaque_picture_has_no_alpha() {
        let image = image::load_from_memory(&encode(1, 2, &[RED; 2]).expect("encodes")).expect("decodes");
        assert_eq!(image.color(), image::ColorType::Rgb8);
        assert_eq!(image.into_bytes(), [255, 0, 0, 255, 0, 0]);
    }

    #[test]
    fn the_file_says_that_it_is_srgb() {
        let bytes = encode(1, 1, &[RED]).expect("encodes");
        // Length 1, the chunk's name, rendering intent 0.
        let chunk = b"\0\0\0\x01sRGB\0";
        assert!(bytes.windows(chunk.len()).any(|window| window == chunk));
    }

    #[test]
    fn too_few_pixels_are_refused_before_anything_is_written() {
        let result = write(&Destination::File("/nonexistent/a.png".into()), 2, 2, &[RED; 3]);
        assert!(matches!(result, Err(OutputError::Shape { found: 3, .. })));
    }
}
