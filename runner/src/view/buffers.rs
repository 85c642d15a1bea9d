//! Views of what passes leave in their buffers, as colours.

use glam::{UVec2, Vec2, Vec3};
use weir_shared::{
    frame::FramePair, light::ENVIRONMENT_BIT, moments::Moments, reservoir::Reservoir, reuse::previous_position,
    scene::Scene as SceneView, surface::Surface,
};

/// What the window shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum View {
    /// The picture.
    #[default]
    Picture,
    /// Shading normals.
    Normals,
    /// Distance from the camera.
    Depth,
    /// Albedo of the diffuse lobe.
    Albedo,
    /// Roughness.
    Roughness,
    /// How far a surface has moved on the screen since the frame before.
    Motion,
    /// Which light the reservoir holds.
    Light,
    /// For how many trials the reservoir stands.
    Confidence,
    /// The contribution weight W of the reservoir.
    Weight,
    /// Whether the reservoir's sample is known to be visible.
    Visibility,
    /// How many light samples were offered to the pixel in this frame.
    Candidates,
    /// Standard error of the pixel's mean.
    Margin,
    /// Difference from the running reference.
    Error,
}

impl View {
    /// All of them, in the order of the menu.
    pub const ALL: [Self; 13] = [
        Self::Picture,
        Self::Normals,
        Self::Depth,
        Self::Albedo,
        Self::Roughness,
        Self::Motion,
        Self::Light,
        Self::Confidence,
        Self::Weight,
        Self::Visibility,
        Self::Candidates,
        Self::Margin,
        Self::Error,
    ];

    /// Name in the menu.
    pub fn name(self) -> &'static str {
        match self {
            Self::Picture => "picture",
            Self::Normals => "normals",
            Self::Depth => "depth",
            Self::Albedo => "albedo",
            Self::Roughness => "roughness",
            Self::Motion => "motion",
            Self::Light => "light id",
            Self::Confidence => "confidence",
            Self::Weight => "weight W",
            Self::Visibility => "visibility",
            Self::Candidates => "candidates",
            Self::Margin => "margin of error",
            Self::Error => "error",
        }
    }

    /// What its colours mean.
    pub fn legend(self) -> &'static str {
        match self {
            Self::Picture => "the tone-mapped picture",
            Self::Normals => "shading normals: x, y, z as red, green, blue; grey is zero",
            Self::Depth => "near is bright; each halving of the brightness is a doubling of the distance",
            Self::Albedo => "albedo of the diffuse lobe",
            Self::Roughness => "perceptual roughness: black is a mirror, white is matte",
            Self::Motion => "pixels since the frame before: red to the right, green down; grey stands still",
            Self::Light => "one colour for each light; black holds none, white is the environment",
            Self::Confidence => "trials behind the sample, on a logarithmic scale from blue (1) to red (512)",
            Self::Weight => "contribution weight W, on a logarithmic scale around its median",
            Self::Visibility => "green: known to be visible; red: not known; black: no sample",
            Self::Candidates => "light samples offered in this frame, on a logarithmic scale from blue (1) to red (64)",
            Self::Margin => "standard error of the mean over the mean: blue 0.1 %, red 100 %; needs a still",
            Self::Error => "difference from the running reference over its value: blue 0.1 %, red 100 %",
        }
    }

    /// The view after this one, or before.
    pub fn step(self, forward: bool) -> Self {
        let at = Self::ALL.iter().position(|view| *view == self).unwrap_or(0);
        let count = Self::ALL.len();
        Self::ALL[(at + if forward { 1 } else { count - 1 }) % count]
    }

    /// Whether it looks at surfaces.
    pub fn needs_surfaces(self) -> bool {
        matches!(self, Self::Normals | Self::Depth | Self::Albedo | Self::Roughness | Self::Motion | Self::Candidates)
    }

    /// Whether it looks at reservoirs.
    pub fn needs_reservoirs(self) -> bool {
        matches!(self, Self::Light | Self::Confidence | Self::Weight | Self::Visibility)
    }

    /// Whether it looks at the mean and its variance.
    pub fn needs_moments(self) -> bool {
        matches!(self, Self::Margin | Self::Error)
    }
}

/// What a frame has left behind; empty where the view does not look.
pub struct Buffers<'a> {
    /// Cameras and scene of this frame and of the one before.
    pub frames: &'a FramePair,
    /// The scene at both.
    pub scene: SceneView<'a>,
    /// What each pixel sees.
    pub surfaces: &'a [Surface],
    /// What each pixel holds at the end of the chain.
    pub reservoirs: &'a [Reservoir],
    /// Mean and variance.
    pub moments: &'a [Moments],
    /// The running reference.
    pub reference: &'a [Vec3],
}

/// Opaque 8-bit colours, red in the low byte.
fn pack(rgb: Vec3) -> u32 {
    let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u32;
    byte(rgb.x) | (byte(rgb.y) << 8) | (byte(rgb.z) << 16) | 0xff00_0000
}

/// From blue through green and yellow to red, for `x` in 0..=1.
fn heat(x: f32) -> Vec3 {
    let x = x.clamp(0.0, 1.0);
    let hat = |center: f32| (1.5 - (4.0 * (x - center)).abs()).clamp(0.0, 1.0);
    Vec3::new(hat(0.78), hat(0.5), hat(0.22))
}

/// `x` between `low` (0) and `high` (1) on a logarithmic scale.
fn logarithmic(x: f32, low: f32, high: f32) -> f32 {
    if x > 0.0 { (x / low).ln() / (high / low).ln() } else { 0.0 }
}

/// A colour of its own for each number.
fn distinct(id: u32) -> Vec3 {
    let hash = id.wrapping_mul(0x9e37_79b1) ^ (id >> 15).wrapping_mul(0x85eb_ca6b);
    let channel = |shift: u32| 0.25 + 0.75 * ((hash >> shift) & 0xff) as f32 / 255.0;
    Vec3::new(channel(0), channel(11), channel(22))
}

/// Where a camera sees a point, in pixels.
fn pixel_of(frame: &weir_shared::frame::Frame, point: Vec3) -> Option<Vec2> {
    let toward = point - frame.camera_origin;
    let depth = toward.dot(frame.camera_forward);
    let along = |axis: Vec3| toward.dot(axis) / axis.length_squared() / depth;
    let place = Vec2::new(along(frame.camera_right), -along(frame.camera_up)) * 0.5 + 0.5;
    (depth > 0.0).then_some(place * Vec2::new(frame.width as f32, frame.height as f32))
}

/// How far what a pixel sees has moved since the frame before, in pixels; nothing where that was not there.
pub fn motion(frames: &FramePair, scene: &SceneView<'_>, surface: &Surface) -> Option<Vec2> {
    let (there, before) = previous_position(&frames.now, &frames.prev, scene, surface);
    let from = pixel_of(&frames.prev, before).filter(|_| there)?;
    Some(pixel_of(&frames.now, surface.position())? - from)
}

fn relative(error: f32, value: f32, floor: f32) -> Vec3 {
    heat(logarithmic(error / value.max(floor), 1e-3, 1.0))
}

fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// A small share of the mean: where the picture is darker, errors are relative to this.
fn floor_of(values: impl Iterator<Item = f32>, count: usize) -> f32 {
    (0.01 * values.filter(|x| x.is_finite()).sum::<f32>() / count.max(1) as f32).max(1e-12)
}

/// The colours of a view. Pixels without anything to show are black.
pub fn false_color(view: View, buffers: &Buffers<'_>) -> Vec<u32> {
    let frame = &buffers.frames.now;
    let pixels = (frame.width * frame.height) as usize;
    let surface_colors = |color: &dyn Fn(&Surface) -> Vec3| -> Vec<u32> {
        let of = |s: &Surface| pack(if s.is_sky() { Vec3::ZERO } else { color(s) });
        buffers.surfaces.iter().map(of).collect()
    };
    let reservoir_colors = |color: &dyn Fn(&Reservoir) -> Vec3| -> Vec<u32> {
        let index = |i: u32| frame.index_of_reservoir(UVec2::new(i % frame.width, i / frame.width), 0) as usize;
        (0..pixels as u32).map(|i| pack(buffers.reservoirs.get(index(i)).map_or(Vec3::ZERO, color))).collect()
    };
    let mut colors = match view {
        View::Picture => Vec::new(),
        View::Normals => surface_colors(&|s| s.normal_shading() * 0.5 + 0.5),
        View::Depth => {
            let distance = |s: &Surface| (s.position() - frame.camera_origin).dot(frame.camera_forward);
            let seen = buffers.surfaces.iter().filter(|s| !s.is_sky()).map(distance);
            let nearest = seen.fold(f32::INFINITY, f32::min).max(1e-12);
            surface_colors(&|s| Vec3::splat(nearest / distance(s)))
        }
        View::Albedo => surface_colors(&|s| s.diffuse().powf(1.0 / 2.2)),
        View::Roughness => surface_colors(&|s| Vec3::splat(s.roughness())),
        View::Motion => surface_colors(&|s| match motion(buffers.frames, &buffers.scene, s) {
            Some(step) => Vec3::new(0.5 + step.x / 32.0, 0.5 + step.y / 32.0, 0.5),
            None => Vec3::new(0.0, 0.0, 1.0),
        }),
        View::Candidates => {
            let offered = |i: usize| {
                let px = UVec2::new(i as u32 % frame.width, i as u32 / frame.width);
                let on_lattice = weir_shared::reuse::is_on_lattice(frame, px);
                if on_lattice { frame.candidates + frame.candidates_bsdf } else { frame.candidates_off_lattice }
            };
            let color = |i: usize, s: &Surface| {
                if s.is_settled() { Vec3::ZERO } else { heat(logarithmic(offered(i) as f32, 1.0, 64.0)) }
            };
            buffers.surfaces.iter().enumerate().map(|(i, s)| pack(color(i, s))).collect()
        }
        View::Light => reservoir_colors(&|r| match r.light {
            _ if !r.has_sample() => Vec3::ZERO,
            light if light & ENVIRONMENT_BIT != 0 => Vec3::ONE,
            light => distinct(light),
        }),
        View::Confidence => reservoir_colors(&|r| match r.confidence() {
            0 => Vec3::ZERO,
            c => heat(logarithmic(c as f32, 1.0, 512.0)),
        }),
        View::Weight => {
            let mut weights: Vec<f32> = buffers.reservoirs.iter().map(|r| r.ucw).filter(|w| *w > 0.0).collect();
            let middle = weights.len() / 2;
            let median = match weights.is_empty() {
                true => 1.0,
                false => *weights.select_nth_unstable_by(middle, f32::total_cmp).1,
            };
            reservoir_colors(&|r| match r.has_sample() {
                true => heat(logarithmic(r.ucw, median / 100.0, median * 100.0)),
                false => Vec3::ZERO,
            })
        }
        View::Visibility => reservoir_colors(&|r| match (r.has_sample(), r.is_known_visible()) {
            (false, _) => Vec3::ZERO,
            (true, false) => Vec3::new(0.8, 0.1, 0.1),
            (true, true) => Vec3::new(0.1, 0.8, 0.1),
        }),
        View::Margin => {
            let floor = floor_of(buffers.moments.iter().map(|m| luminance(m.mean())), pixels);
            let error = |m: &Moments| luminance(m.variance_of_mean()).max(0.0).sqrt();
            buffers.moments.iter().map(|m| pack(relative(error(m), luminance(m.mean()), floor))).collect()
        }
        View::Error => {
            let floor = floor_of(buffers.reference.iter().map(|r| luminance(*r)), pixels);
            let pairs = buffers.moments.iter().zip(buffers.reference);
            pairs.map(|(m, r)| pack(relative(luminance((m.mean() - *r).abs()), luminance(*r), floor))).collect()
        }
    };
    colors.resize(pixels, 0xff00_0000);
    colors
}

#[cfg(test)]
mod tests {
    use super::*;
    use weir_shared::{frame::Frame, octahedral};

    const BLACK: u32 = 0xff00_0000;

    fn pair() -> FramePair {
        let now = Frame {
            width: 2,
            height: 1,
            reservoirs: 1,
            camera_forward: Vec3::NEG_Z,
            camera_right: Vec3::X,
            camera_up: Vec3::Y * 0.5,
            candidates: 4,
            ..Frame::default()
        };
        FramePair { now, prev: now }
    }

    fn surface(position: [f32; 3]) -> Surface {
        let normal = octahedral::pack(Vec3::Z);
        Surface { position, normal_shading: normal, instance: 0x8000_0000, ..Surface::default() }
    }

    fn colors(view: View, frames: &FramePair, surfaces: &[Surface], reservoirs: &[Reservoir]) -> Vec<u32> {
        let scene = SceneView { triangles: &[], records: &[], texels: &[] };
        false_color(view, &Buffers { frames, scene, surfaces, reservoirs, moments: &[], reference: &[] })
    }

    fn channels(color: u32) -> [u32; 3] {
        [color & 0xff, (color >> 8) & 0xff, (color >> 16) & 0xff]
    }

    #[test]
    fn sky_and_empty_reservoirs_are_black_in_every_view() {
        for view in View::ALL {
            let shown = colors(view, &pair(), &[Surface::default(); 2], &[Reservoir::EMPTY; 2]);
            assert_eq!(shown, [BLACK; 2], "{}", view.name());
        }
    }

    #[test]
    fn normals_and_depth_have_their_usual_colors() {
        let surfaces = [surface([0.0, 0.0, -2.0]), surface([0.0, 0.0, -4.0])];
        assert_eq!(channels(colors(View::Normals, &pair(), &surfaces, &[])[0]), [128, 128, 255]);
        let depth = colors(View::Depth, &pair(), &surfaces, &[]);
        assert_eq!((channels(depth[0])[0], channels(depth[1])[0]), (255, 128));
    }

    #[test]
    fn motion_shows_how_the_camera_has_moved() {
        let mut frames = pair();
        frames.prev.camera_origin = Vec3::new(1.0, 0.0, 0.0);
        let at = surface([0.0, 0.0, -1.0]);
        let scene = SceneView { triangles: &[], records: &[], texels: &[] };
        // One unit is half the width of the picture at this distance: one pixel of two.
        assert_eq!(motion(&frames, &scene, &at), Some(Vec2::new(1.0, 0.0)));
        assert_eq!(motion(&pair(), &scene, &at), Some(Vec2::ZERO));
        let still = colors(View::Motion, &pair(), &[at; 2], &[])[0];
        assert!(channels(colors(View::Motion, &frames, &[at; 2], &[])[0])[0] > channels(still)[0]);
    }

    #[test]
    fn reservoirs_show_their_light_their_confidence_and_what_is_known_of_visibility() {
        let pair = pair();
        let held = [Reservoir::new(3, 0, 1.0, 1), Reservoir::new(4, 0, 1.0, 512).known_visible()];
        let lights = colors(View::Light, &pair, &[], &held);
        assert!(lights[0] != lights[1] && lights[0] != BLACK);
        let confidence = colors(View::Confidence, &pair, &[], &held);
        assert!(channels(confidence[0])[2] > 100 && channels(confidence[1])[0] > 100, "{confidence:x?}");
        let [red, green] = colors(View::Visibility, &pair, &[], &held)[..] else { panic!("two pixels") };
        assert!(channels(red)[0] > channels(red)[1] && channels(green)[1] > channels(green)[0]);
        let environment = [Reservoir::new(ENVIRONMENT_BIT, 0, 1.0, 1); 2];
        assert_eq!(channels(colors(View::Light, &pair, &[], &environment)[0]), [255; 3]);
    }

    #[test]
    fn errors_are_hot_where_the_picture_is_off() {
        let frames = pair();
        let moments = [Moments::default().with(Vec3::ONE, 0), Moments::default().with(Vec3::splat(2.0), 0)];
        let scene = SceneView { triangles: &[], records: &[], texels: &[] };
        let reference = [Vec3::ONE; 2];
        let buffers = Buffers {
            frames: &frames,
            scene,
            surfaces: &[],
            reservoirs: &[],
            moments: &moments,
            reference: &reference,
        };
        let [right, wrong] = false_color(View::Error, &buffers)[..] else { panic!("two pixels") };
        assert!(channels(right)[2] > channels(right)[0] && channels(wrong)[0] > channels(wrong)[2]);
    }

    #[test]
    fn steps_go_through_all_views_and_back() {
        let mut view = View::Picture;
        for expected in View::ALL.into_iter().skip(1) {
            view = view.step(true);
            assert_eq!(view, expected);
        }
        assert_eq!(view.step(true), View::Picture);
        assert_eq!(View::Picture.step(false), View::Error);
    }
}
