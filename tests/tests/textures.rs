//! Textures and environment maps: each file once, in the right encoding, and no larger than allowed.

use std::io::Cursor;

use exr::prelude::WritableImage;
use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgb, Rgba};
use weir::scene::Scene;
use weir::scene::environment;
use weir::scene::load::{LoadOptions, Loaded, load_from};
use weir::scene::source::Memory;

fn encoded(image: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    image.into().write_to(&mut file, format).expect("memory");
    file.into_inner()
}

fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
    encoded(image, ImageFormat::Png)
}

/// A scene with a material for each of `statements`.
fn load(statements: &[&str], files: &[(&str, &[u8])], options: &LoadOptions) -> (Scene, Vec<String>) {
    let mut obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n".to_owned();
    let mut mtl = String::new();
    for (index, statements) in statements.iter().enumerate() {
        obj.push_str(&format!("usemtl m{index}\nf 1 2 3\n"));
        mtl.push_str(&format!("newmtl m{index}\n{statements}\n"));
    }
    let mut source: Memory = files.iter().copied().collect();
    source.insert("a.obj", obj);
    source.insert("a.mtl", mtl);
    let Loaded { scene, warnings } = load_from(&source, "a.obj", options).expect("loads");
    (scene, warnings.iter().map(ToString::to_string).collect())
}

fn texel(rgba: [u8; 4]) -> u32 {
    u32::from_le_bytes(rgba)
}

#[test]
fn a_texture_is_read_top_row_first_with_red_in_the_low_byte() {
    let image = ImageBuffer::from_fn(2, 2, |x, y| Rgb([x as u8 * 10, y as u8 * 20, 30]));
    let (scene, warnings) = load(&["map_Kd t.png"], &[("t.png", &png(image))], &LoadOptions::default());
    let expected = [[0, 0, 30, 255], [10, 0, 30, 255], [0, 20, 30, 255], [10, 20, 30, 255]].map(texel);
    assert_eq!(scene.textures[0].texels, expected);
    assert_eq!(warnings, Vec::<String>::new());
}

#[test]
fn grey_deep_and_jpeg_images_become_eight_bits() {
    let grey = png(ImageBuffer::from_pixel(1, 1, Luma([77_u8])));
    let deep = png(ImageBuffer::from_pixel(1, 1, Rgb([0xFFFF_u16, 0x8080, 0])));
    let jpeg = encoded(ImageBuffer::from_pixel(16, 16, Rgb([200_u8, 200, 200])), ImageFormat::Jpeg);
    let files: [(&str, &[u8]); 3] = [("g.png", &grey), ("d.png", &deep), ("j.jpg", &jpeg)];
    let (scene, warnings) = load(&["map_Kd g.png", "map_Kd d.png", "map_Kd j.jpg"], &files, &LoadOptions::default());
    assert_eq!(scene.textures[0].texels, [texel([77, 77, 77, 255])]);
    assert_eq!(scene.textures[1].texels, [texel([255, 128, 0, 255])]);
    assert!(scene.textures[2].texels.iter().all(|&t| t.to_le_bytes()[0].abs_diff(200) < 3));
    assert_eq!(warnings, ["a.mtl:4: texture `d.png` was reduced from 16 to 8 bits a channel"]);
}

#[test]
fn a_mask_is_the_alpha_of_an_image_that_has_any_and_its_red_otherwise() {
    let leaf = png(ImageBuffer::from_fn(2, 1, |x, _| Rgba([255_u8, 9, 9, x as u8 * 200])));
    let holes = png(ImageBuffer::from_fn(2, 1, |x, _| Rgb([x as u8 * 100, 0, 0])));
    let files: [(&str, &[u8]); 2] = [("leaf.png", &leaf), ("holes.png", &holes)];
    let (scene, _) = load(&["map_Kd leaf.png\nmap_d leaf.png", "map_d holes.png"], &files, &LoadOptions::default());
    let red = |index: u32| scene.textures[index as usize].texels.iter().map(|t| t & 255).collect::<Vec<_>>();
    let mask = |material: usize| scene.materials[material].alpha_texture.expect("a mask");
    assert_eq!((red(mask(0)), red(mask(1))), (vec![0, 200], vec![0, 100]));
    assert_eq!(red(scene.materials[0].base_color_texture.expect("a colour")), [255, 255]);
    assert!(!scene.textures[mask(0) as usize].srgb);
}

#[test]
fn equal_files_and_equal_names_share_a_texture() {
    let image = png(ImageBuffer::from_pixel(1, 1, Rgb([1_u8, 2, 3])));
    let files: [(&str, &[u8]); 2] = [("t.png", &image), ("sub/copy.png", &image)];
    let names = ["map_Kd t.png", "map_Kd ./t.png", "map_Kd sub\\copy.png", "map_Ke t.png", "map_d t.png"];
    let (scene, warnings) = load(&names, &files, &LoadOptions::default());
    let bound = |index: usize| scene.materials[index].base_color_texture;
    assert_eq!((bound(0), bound(1), bound(2)), (Some(0), Some(0), Some(0)));
    assert_eq!((scene.materials[3].emission_texture, scene.materials[4].alpha_texture), (Some(0), Some(1)));
    assert_eq!((scene.textures.len(), warnings.len()), (2, 0), "{warnings:?}");
}

#[test]
fn textures_are_relative_to_their_library() {
    let image = png(ImageBuffer::from_pixel(1, 1, Rgb([1_u8, 2, 3])));
    let source = Memory::from_iter([
        ("a.obj", &b"mtllib sub/a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n"[..]),
        ("sub/a.mtl", b"newmtl m\nmap_Kd t.png\n"),
        ("sub/t.png", &image),
    ]);
    let Loaded { scene, warnings } = load_from(&source, "a.obj", &LoadOptions::default()).expect("loads");
    assert_eq!((scene.textures.len(), warnings.len()), (1, 0));
}

#[test]
fn the_largest_textures_are_halved_to_fit_the_budget() {
    let large = png(ImageBuffer::from_pixel(64, 32, Rgb([9_u8, 9, 9])));
    let small = png(ImageBuffer::from_pixel(4, 4, Rgb([8_u8, 8, 8])));
    let files: [(&str, &[u8]); 2] = [("l.png", &large), ("s.png", &small)];
    let options = LoadOptions { texture_budget_bytes: 600, ..LoadOptions::default() };
    let (scene, warnings) = load(&["map_Kd l.png", "map_Kd s.png"], &files, &options);
    let size = |index: usize| (scene.textures[index].width, scene.textures[index].height);
    assert_eq!((size(0), size(1)), ((16, 8), (4, 4)));
    assert!(scene.textures[0].texels.iter().all(|&t| t == texel([9, 9, 9, 255])));
    assert_eq!(warnings, ["a.mtl: textures were reduced in size to fit the budget of 600 bytes for all: 1"]);
}

fn exr_map(width: usize, height: usize, pixel: impl Fn(usize, usize) -> f32 + Sync) -> Vec<u8> {
    let pixel = |at: exr::math::Vec2<usize>| (pixel(at.x(), at.y()), 1.0_f32, 0.5_f32);
    let image = exr::image::Image::from_channels((width, height), exr::image::SpecificChannels::rgb(pixel));
    let mut file = Cursor::new(Vec::new());
    image.write().to_buffered(&mut file).expect("memory");
    file.into_inner()
}

#[test]
fn environment_maps_keep_their_values_and_first_row() {
    let file = exr_map(4, 2, |x, y| (x + 10 * y) as f32);
    let (map, warnings) = environment::decode(&file, "sky.exr", 90.0, 2.0).expect("sound");
    assert_eq!((map.width, map.height, map.rotation_deg, map.scale), (4, 2, 90.0, 2.0));
    assert_eq!((map.texels[1], map.texels[7]), ([1.0, 1.0, 0.5], [13.0, 1.0, 0.5]));
    assert!(warnings.is_empty());

    let rgb = ImageBuffer::from_fn(4, 2, |x, y| Rgb([x as f32 + 4.0 * y as f32, 1.0, 0.5]));
    let file = encoded(rgb, ImageFormat::Hdr);
    let (map, _) = environment::decode(&file, "sky.hdr", 0.0, 1.0).expect("sound");
    assert_eq!((map.texels[0][1], map.texels[7][0]), (1.0, 7.0));
}

#[test]
fn maps_with_luminance_alone_are_grey() {
    let pixel = |at: exr::math::Vec2<usize>| (at.x() as f32,);
    let channels = exr::image::SpecificChannels::build().with_channel("Y").with_pixel_fn(pixel);
    let mut file = Cursor::new(Vec::new());
    exr::image::Image::from_channels((4, 2), channels).write().to_buffered(&mut file).expect("memory");
    let (map, _) = environment::decode(file.get_ref(), "sky.exr", 0.0, 1.0).expect("sound");
    assert_eq!(map.texels[3], [3.0; 3]);
}

#[test]
fn values_that_are_no_radiance_are_replaced_and_counted() {
    let values = [f32::NAN, f32::INFINITY, -1.0, 1e30, 2.0, -0.0, f32::NEG_INFINITY, 1e20];
    let file = exr_map(4, 2, |x, y| values[x + 4 * y]);
    let (map, warnings) = environment::decode(&file, "sky.exr", 0.0, 1.0).expect("sound");
    let red: Vec<_> = map.texels.iter().map(|texel| texel[0]).collect();
    assert_eq!(red, [0.0, 0.0, 0.0, 1e20, 2.0, 0.0, 0.0, 1e20]);
    let warnings: Vec<_> = warnings.iter().map(ToString::to_string).collect();
    assert_eq!(
        warnings,
        [
            "sky.exr: values that are negative or not finite, replaced by 0: 4",
            "sky.exr: values above 1e20, reduced to it: 1",
        ]
    );
}

#[test]
fn wide_maps_are_reduced_with_their_mean_kept() {
    let file = exr_map(8194, 2, |x, _| if x < 3 { 3.0 } else { 0.0 });
    let (map, warnings) = environment::decode(&file, "sky.exr", 0.0, 1.0).expect("sound");
    assert_eq!((map.width, map.height), (2732, 1));
    assert_eq!((map.texels[0], map.texels[1], map.texels[2731]), ([3.0, 1.0, 0.5], [0.0, 1.0, 0.5], [0.0, 1.0, 0.5]));
    assert_eq!(warnings[0].to_string(), "sky.exr: the map was reduced from 8194x2 to 2732x1 pixels");
}

#[test]
fn what_is_not_a_map_is_refused_with_a_remedy() {
    let sound = exr_map(4, 2, |_, _| 1.0);
    let cases: [(&[u8], f32, f32, &str); 6] = [
        (b"", 0.0, 1.0, "neither a Radiance HDR nor an OpenEXR file"),
        (b"P6 1 1 255 ...", 0.0, 1.0, "neither a Radiance HDR nor an OpenEXR file"),
        (&sound[..sound.len() / 2], 0.0, 1.0, "sky: "),
        (&sound, f32::NAN, 1.0, "rotation NaN or scale 1 is out of range"),
        (&sound, 0.0, -1.0, "rotation 0 or scale -1 is out of range"),
        (&sound, 0.0, f32::INFINITY, "scale inf is out of range"),
    ];
    for (contents, rotation_deg, scale, expected) in cases {
        let error = environment::decode(contents, "sky", rotation_deg, scale).expect_err(expected).to_string();
        assert!(error.starts_with("sky: ") && error.contains(expected) && error.contains("\nhelp: "), "{error}");
    }
}
