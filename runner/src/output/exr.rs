//! OpenEXR: linear pictures with everything else that is known of each pixel, and of how they were made.
//!
//! Channel and attribute names are those that pbrt, tev, OpenImageIO and Blender read.

use std::io::Cursor;

use ::exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, Text,
    Vec2, WritableImage, attribute::Chromaticities,
};
use glam::Mat4;

use super::{Destination, Layers, OutputError, Picture, atomic, check_shape};

mod read;

pub use read::{Channel, ReadError, Samples, read};

/// How a picture was made. What is `None` is not written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metadata {
    /// Time spent rendering (`renderTimeSeconds`).
    pub render_time_s: Option<f32>,
    /// Samples a pixel (`samplesPerPixel`).
    pub samples_per_pixel: Option<u32>,
    /// Camera space looks along -z with y up (`worldToCamera`).
    pub camera_from_world: Option<Mat4>,
    /// From world space to normalized device coordinates (`worldToNDC`).
    pub ndc_from_world: Option<Mat4>,
    /// Local time, `YYYY:MM:DD hh:mm:ss` (`capDate`).
    pub capture_date: Option<String>,
    /// All settings, as JSON (`weir:settings`).
    pub settings: Option<String>,
    /// Seed of the random numbers (`weir:seed`; text, because EXR integers have 31 bits).
    pub seed: Option<u64>,
    /// Digest of scene and settings (`weir:digest`).
    pub digest: Option<String>,
    /// What rendered it (`weir:adapter`).
    pub adapter: Option<String>,
}

/// Writes a picture and its layers: 32-bit channels, lossless ZIP. The same input gives the same bytes.
///
/// # Errors
///
/// A layer does not match the size of the picture, or the destination cannot be written.
pub fn write(
    destination: &Destination,
    picture: &Picture,
    layers: &Layers,
    metadata: &Metadata,
) -> Result<(), OutputError> {
    atomic::write(destination, &encode(picture, layers, metadata)?)
}

fn encode(picture: &Picture, layers: &Layers, metadata: &Metadata) -> Result<Vec<u8>, OutputError> {
    let channels = AnyChannels::sort(channels(picture, layers)?);
    let size = Vec2(picture.width as usize, picture.height as usize);
    let layer = Layer::new(size, attributes(metadata), Encoding::SMALL_LOSSLESS, channels);
    let mut image = Image::from_layer(layer);
    image.attributes.chromaticities = Some(REC_709);

    let mut bytes = Cursor::new(Vec::new());
    image
        .write()
        .to_buffered(&mut bytes)
        .map_err(|error| OutputError::Encode { format: "EXR", reason: error.to_string() })?;
    Ok(with_sorted_attributes(bytes.into_inner()))
}

/// Primaries and white point (D65) of Rec. 709.
const REC_709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

type Channels = SmallVec<[AnyChannel<FlatSamples>; 4]>;

fn channels(picture: &Picture, layers: &Layers) -> Result<Channels, OutputError> {
    let (width, height) = (picture.width, picture.height);
    let mut list = Channels::new();
    let mut push = |name: &'static str, samples: FlatSamples| {
        check_shape(name, samples.len(), width, height)?;
        list.push(AnyChannel::new(name, samples));
        Ok::<_, OutputError>(())
    };

    let triples = [
        (["R", "G", "B"], Some(&picture.rgb)),
        (["N.X", "N.Y", "N.Z"], layers.normal_geometric.as_ref()),
        (["Ns.X", "Ns.Y", "Ns.Z"], layers.normal_shading.as_ref()),
        (["P.X", "P.Y", "P.Z"], layers.position.as_ref()),
        (["Albedo.R", "Albedo.G", "Albedo.B"], layers.albedo.as_ref()),
        (["Variance.R", "Variance.G", "Variance.B"], layers.variance.as_ref()),
        (["RelativeVariance.R", "RelativeVariance.G", "RelativeVariance.B"], layers.relative_variance.as_ref()),
    ];
    for (names, values) in triples {
        let Some(values) = values else { continue };
        for (component, name) in names.into_iter().enumerate() {
            push(name, FlatSamples::F32(values.iter().map(|value| value[component]).collect()))?;
        }
    }
    for (name, values) in [("A", &picture.alpha), ("Z", &layers.depth)] {
        if let Some(values) = values {
            push(name, FlatSamples::F32(values.clone()))?;
        }
    }
    for (name, values) in [("samples", &layers.samples), ("light.id", &layers.light_id)] {
        if let Some(values) = values {
            push(name, FlatSamples::U32(values.clone()))?;
        }
    }
    Ok(list)
}

fn attributes(metadata: &Metadata) -> LayerAttributes {
    let mut attributes = LayerAttributes::named("rgba");
    attributes.software_name = Some(text(concat!("weir ", env!("CARGO_PKG_VERSION"))));
    attributes.capture_date = metadata.capture_date.as_deref().map(text);
    // OpenEXR multiplies row vectors and stores row by row: the same 16 numbers in the same order as glam's columns.
    attributes.world_to_camera = metadata.camera_from_world.map(|matrix| matrix.to_cols_array());
    attributes.world_to_normalized_device = metadata.ndc_from_world.map(|matrix| matrix.to_cols_array());

    let integer = |value: u32| AttributeValue::I32(i32::try_from(value).unwrap_or(i32::MAX));
    let others = [
        ("colorInteropID", Some(AttributeValue::Text(text("lin_rec709_scene")))),
        ("renderTimeSeconds", metadata.render_time_s.map(AttributeValue::F32)),
        ("samplesPerPixel", metadata.samples_per_pixel.map(integer)),
        ("weir:settings", metadata.settings.as_deref().map(text).map(AttributeValue::Text)),
        ("weir:seed", metadata.seed.map(|seed| AttributeValue::Text(text(&seed.to_string())))),
        ("weir:digest", metadata.digest.as_deref().map(text).map(AttributeValue::Text)),
        ("weir:adapter", metadata.adapter.as_deref().map(text).map(AttributeValue::Text)),
    ];
    let present = others.into_iter().filter_map(|(name, value)| Some((text(name), value?)));
    attributes.other.extend(present);
    attributes
}

/// UTF-8 as it is: the format fixes no encoding, and other readers take bytes.
fn text(string: &str) -> Text {
    Text::from_slice_unchecked(string.as_bytes())
}

/// Orders the attributes of a single-part file by name; the encoder's order changes from run to run.
fn with_sorted_attributes(mut file: Vec<u8>) -> Vec<u8> {
    // Magic number and version; then attributes (name, type, size, value); then a zero byte.
    const START: usize = 8;
    let mut attributes = Vec::new();
    let mut at = START;
    while file[at] != 0 {
        let after_zero =
            |from: usize| from + file[from..].iter().position(|byte| *byte == 0).expect("names end in a zero byte") + 1;
        let size_at = after_zero(after_zero(at));
        let size: [u8; 4] = file[size_at..size_at + 4].try_into().expect("four bytes");
        let end = size_at + 4 + u32::from_le_bytes(size) as usize;
        attributes.push(file[at..end].to_vec());
        at = end;
    }
    // The bytes start with the name and its final zero, so this sorts by name; the total length stays.
    attributes.sort_unstable();
    file[START..at].copy_from_slice(&attributes.concat());
    file
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::exr::read::decode;

    /// Three values a pixel, all distinct, so that swapped channels, rows or layers show.
    fn triples(base: f32) -> Vec<[f32; 3]> {
        (0..6).map(|pixel| [0.0, 0.1, 0.2].map(|offset| base + pixel as f32 + offset)).collect()
    }

    fn picture() -> Picture {
        Picture { width: 3, height: 2, rgb: triples(0.0), alpha: Some((0..6).map(|i| i as f32 / 6.0).collect()) }
    }

    fn all_layers() -> Layers {
        Layers {
            depth: Some((0..6).map(|i| 1e-20 * i as f32).collect()),
            normal_geometric: Some(triples(10.0)),
            normal_shading: Some(triples(20.0)),
            position: Some(triples(-30.0)),
            albedo: Some(triples(40.0)),
            variance: Some(triples(1e10)),
            relative_variance: Some(triples(60.0)),
            samples: Some((0..6).collect()),
            light_id: Some((0..6).map(|i| u32::MAX - i).collect()),
        }
    }

    fn all_metadata() -> Metadata {
        Metadata {
            render_time_s: Some(1.5),
            samples_per_pixel: Some(64),
            camera_from_world: Some(Mat4::from_translation(glam::Vec3::new(1.0, 2.0, 3.0))),
            ndc_from_world: Some(Mat4::IDENTITY),
            capture_date: Some("2026:01:02 03:04:05".into()),
            settings: Some(r#"{"scene":"Küche"}"#.into()),
            seed: Some(u64::MAX),
            digest: Some("ab12".into()),
            adapter: Some("cpu".into()),
        }
    }

    #[test]
    fn every_channel_comes_back_unchanged() {
        let (picture, layers) = (picture(), all_layers());
        let bytes = encode(&picture, &layers, &all_metadata()).expect("encodes");
        let (read_picture, channels) = decode(&bytes).expect("decodes");
        assert_eq!(read_picture, picture);

        let float = |name: &str| match &channels.iter().find(|channel| channel.name == name).expect(name).samples {
            Samples::Float(values) => values.clone(),
            Samples::Uint(_) => panic!("`{name}` is not float"),
        };
        let triples = [
            ("N", "XYZ", &layers.normal_geometric),
            ("Ns", "XYZ", &layers.normal_shading),
            ("P", "XYZ", &layers.position),
            ("Albedo", "RGB", &layers.albedo),
            ("Variance", "RGB", &layers.variance),
            ("RelativeVariance", "RGB", &layers.relative_variance),
        ];
        for (layer, components, expected) in triples {
            let expected = expected.as_ref().expect("all layers are there");
            for (index, component) in components.chars().enumerate() {
                let expected: Vec<f32> = expected.iter().map(|value| value[index]).collect();
                assert_eq!(float(&format!("{layer}.{component}")), expected, "{layer}.{component}");
            }
        }
        assert_eq!(Some(float("Z")), layers.depth);
        for (name, expected) in [("samples", &layers.samples), ("light.id", &layers.light_id)] {
            let found = channels.iter().find(|channel| channel.name == name).map(|channel| &channel.samples);
            assert_eq!(found, expected.clone().map(Samples::Uint).as_ref(), "{name}");
        }
        assert_eq!(channels.len(), 6 * 3 + 3);
    }

    #[test]
    fn only_what_is_present_is_written() {
        let picture = Picture { alpha: None, ..picture() };
        let bytes = encode(&picture, &Layers::default(), &Metadata::default()).expect("encodes");
        assert_eq!(decode(&bytes).expect("decodes"), (picture, vec![]));
    }

    #[test]
    fn every_attribute_is_in_the_header() {
        let bytes = encode(&picture(), &Layers::default(), &all_metadata()).expect("encodes");
        let meta = ::exr::meta::MetaData::read_from_buffered(&bytes[..], true).expect("a valid header");
        let header = &meta.headers[0];
        let own = &header.own_attributes;
        assert_eq!(header.shared_attributes.chromaticities, Some(REC_709));
        assert_eq!(own.layer_name, Some(text("rgba")));
        assert_eq!(own.software_name, Some(text(concat!("weir ", env!("CARGO_PKG_VERSION")))));
        assert_eq!(own.capture_date, Some(text("2026:01:02 03:04:05")));
        // Row vectors: the translation is the last row.
        assert_eq!(own.world_to_camera.expect("written")[12..], [1.0, 2.0, 3.0, 1.0]);
        assert_eq!(own.world_to_normalized_device, Some(Mat4::IDENTITY.to_cols_array()));
        let expected = [
            ("colorInteropID", AttributeValue::Text(text("lin_rec709_scene"))),
            ("renderTimeSeconds", AttributeValue::F32(1.5)),
            ("samplesPerPixel", AttributeValue::I32(64)),
            ("weir:settings", AttributeValue::Text(text(r#"{"scene":"Küche"}"#))),
            ("weir:seed", AttributeValue::Text(text("18446744073709551615"))),
            ("weir:digest", AttributeValue::Text(text("ab12"))),
            ("weir:adapter", AttributeValue::Text(text("cpu"))),
        ];
        for (name, value) in expected {
            let found = own.other.get(&text(name)).or(header.shared_attributes.other.get(&text(name)));
            assert_eq!(found, Some(&value), "{name}");
        }
    }

    /// The encoder keeps attributes in a hash map with a random seed: ten files would agree by chance only.
    #[test]
    fn the_same_input_gives_the_same_bytes() {
        let file = || encode(&picture(), &all_layers(), &all_metadata()).expect("encodes");
        let first = file();
        assert!((0..9).all(|_| file() == first));
    }

    #[test]
    fn a_layer_of_another_size_is_refused_by_name() {
        let layers = Layers { albedo: Some(vec![[0.0; 3]; 5]), ..Layers::default() };
        let error = encode(&picture(), &layers, &Metadata::default()).expect_err("5 values for 6 pixels");
        assert!(matches!(error, OutputError::Shape { channel: "Albedo.R", found: 5, .. }));
    }

    #[test]
    fn a_picture_without_pixels_is_refused() {
        let error = encode(&Picture::default(), &Layers::default(), &Metadata::default()).expect_err("0x0");
        assert!(matches!(error, OutputError::Empty { .. }));
    }
}
