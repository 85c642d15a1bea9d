//! Previews of the built-in scenes.

use egui::{ColorImage, TextureHandle, TextureOptions, Ui, load::SizedTexture, vec2};

/// Small pictures, by the name of the scene.
const PREVIEWS: [(&str, &[u8]); 4] = [
    ("cornell", include_bytes!("../../../assets/pictures/gallery/cornell.png")),
    ("studio", include_bytes!("../../../assets/pictures/gallery/studio.png")),
    ("rooms", include_bytes!("../../../assets/pictures/gallery/rooms.png")),
    ("park", include_bytes!("../../../assets/pictures/gallery/park.png")),
];

fn decoded(name: &str) -> Option<ColorImage> {
    let (_, png) = PREVIEWS.iter().find(|(scene, _)| *scene == name)?;
    let image = image::load_from_memory_with_format(png, image::ImageFormat::Png).ok()?.into_rgba8();
    Some(ColorImage::from_rgba_unmultiplied([image.width() as usize, image.height() as usize], image.as_raw()))
}

/// The preview of a built-in scene; nothing where there is none.
pub fn preview(ui: &mut Ui, name: &str) {
    let id = egui::Id::unique(("preview", name));
    let texture = ui.data(|data| data.get_temp::<TextureHandle>(id)).or_else(|| {
        let texture = ui.ctx().load_texture(name, decoded(name)?, TextureOptions::LINEAR);
        ui.data_mut(|data| data.insert_temp(id, texture.clone()));
        Some(texture)
    });
    if let Some(texture) = texture {
        let image = SizedTexture::new(texture.id(), vec2(64.0, 36.0));
        ui.add(egui::Image::from_texture(image).alt_text(format!("preview of {name}")));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin::BUILTIN;

    #[test]
    fn every_built_in_scene_has_a_preview_with_something_in_it() {
        for scene in BUILTIN {
            let image = decoded(scene.name).expect("a picture");
            assert_eq!(image.size, [96, 54]);
            let bright = image.pixels.iter().filter(|pixel| pixel.r() > 60).count();
            assert!(bright > 50, "{}: {bright} bright pixels", scene.name);
        }
    }
}
