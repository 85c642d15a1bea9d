//! The statements of material libraries, and what each expects.

/// Largest radiance that a material may emit: f32 arithmetic on it stays finite.
pub const MAX_RADIANCE: f64 = 1e20;

/// What a keyword expects, and what happens to values outside.
#[derive(Clone, Copy)]
pub enum Kind {
    /// Up to three numbers, each clamped to 0..=the bound.
    Color(f64),
    /// A number, clamped to the range.
    Number(f64, f64),
    /// A file name after options.
    Map,
    /// The number of an illumination model.
    Model,
    /// Known, but without effect here.
    Unsupported,
    /// Known, without effect, and not worth a word.
    Silent,
}

/// Spelled as `tobj` wants them; files vary in case.
pub const KEYWORDS: [(&str, Kind); 37] = [
    ("Ka", Kind::Color(f64::MAX)),
    ("Kd", Kind::Color(1.0)),
    ("Ks", Kind::Color(1.0)),
    ("Ke", Kind::Color(MAX_RADIANCE)),
    ("Ns", Kind::Number(0.0, 1e9)),
    ("Ni", Kind::Number(0.001, 1e3)),
    ("d", Kind::Number(0.0, 1.0)),
    ("Tr", Kind::Number(0.0, 1.0)),
    ("Pr", Kind::Number(0.0, 1.0)),
    ("Pm", Kind::Number(0.0, 1.0)),
    ("illum", Kind::Model),
    ("map_Kd", Kind::Map),
    ("map_Ke", Kind::Map),
    ("map_d", Kind::Map),
    ("map_Ka", Kind::Silent),
    ("Tf", Kind::Silent),
    ("sharpness", Kind::Silent),
    ("map_aat", Kind::Silent),
    ("map_Ks", Kind::Unsupported),
    ("map_Ns", Kind::Unsupported),
    ("map_Pr", Kind::Unsupported),
    ("map_Pm", Kind::Unsupported),
    ("map_Ps", Kind::Unsupported),
    ("map_RMA", Kind::Unsupported),
    ("map_ORM", Kind::Unsupported),
    ("map_Tr", Kind::Unsupported),
    ("map_bump", Kind::Unsupported),
    ("bump", Kind::Unsupported),
    ("norm", Kind::Unsupported),
    ("disp", Kind::Unsupported),
    ("decal", Kind::Unsupported),
    ("refl", Kind::Unsupported),
    ("Ps", Kind::Unsupported),
    ("Pc", Kind::Unsupported),
    ("Pcr", Kind::Unsupported),
    ("aniso", Kind::Unsupported),
    ("anisor", Kind::Unsupported),
];
