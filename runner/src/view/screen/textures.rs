//! egui's textures on the host: what a screen that is made anew has to be told, and what the host draws with.

use std::{collections::HashMap, sync::Arc};

use egui::{
    TextureId, TextureOptions, TexturesDelta,
    epaint::{ColorImage, ImageData, ImageDelta},
};

/// All textures that egui uses now.
#[derive(Default)]
pub struct Textures {
    images: HashMap<TextureId, (ColorImage, TextureOptions)>,
    nothing: TexturesDelta,
}

impl Textures {
    /// Takes over what has changed.
    pub fn update(&mut self, delta: &TexturesDelta) {
        for (id, changes) in &delta.set {
            for change in changes {
                let ImageData::Color(image) = &change.image;
                match (change.pos, self.images.get_mut(id)) {
                    (Some([left, top]), Some((whole, _))) => {
                        for (y, row) in image.pixels.chunks_exact(image.size[0].max(1)).enumerate() {
                            let start = (top + y) * whole.size[0] + left;
                            if let Some(texels) = whole.pixels.get_mut(start..start + row.len()) {
                                texels.copy_from_slice(row);
                            }
                        }
                    }
                    _ => drop(self.images.insert(*id, (ColorImage::clone(image), change.options))),
                }
            }
        }
    }

    /// Lets go of what is no longer used.
    pub fn free(&mut self, delta: &TexturesDelta) {
        delta.free.iter().for_each(|id| drop(self.images.remove(id)));
    }

    /// No change at all.
    pub fn none(&self) -> &TexturesDelta {
        &self.nothing
    }

    /// A texture.
    pub fn get(&self, id: TextureId) -> Option<&ColorImage> {
        self.images.get(&id).map(|(image, _)| image)
    }

    /// All of them, for a screen that has none.
    pub fn all(&self) -> TexturesDelta {
        let mut delta = TexturesDelta::default();
        for (id, (image, options)) in &self.images {
            delta.set.entry(*id).or_default().push(ImageDelta::full(Arc::new(image.clone()), *options));
        }
        delta
    }
}
