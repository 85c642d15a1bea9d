//! The picture that others are judged by: made once, and kept under the user's cache folder.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use etcetera::BaseStrategy as _;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Halt, Target, methods::Method, results::ReferenceFacts};
use crate::{
    exit::{Exit, HasExit},
    margin::FLOOR,
    output::{
        Destination, Picture, atomic,
        compare::noise_rel_mse,
        exr::{self, Metadata, ReadError, Samples},
    },
    packed::PackedScene,
    render::{Backend, RenderError, Rendered, Request, Stop, layers, render, render_reference},
    technique::Technique,
};

/// Seed of references: none that a method gets.
const SEED: u32 = 0x5eed_0000;
/// Of a cached reference that was given this share of the time asked for, no better one is made.
const GOOD_ENOUGH: f32 = 0.9;
/// With more lights than this the reference integrator, which draws them uniformly, would find few that matter, and the
/// variance of what it finds would not say so.
const MOST_UNIFORM: u32 = 1024;

/// A file that can't be the reference.
#[derive(Debug, Error)]
pub enum JudgeError {
    /// It cannot be read.
    #[error("the reference: {0}")]
    Read(#[from] ReadError),
    /// It has another size.
    #[error("the reference is {}x{}, not {}x{}; name one of that size, or leave it out: {}", found[0], found[1], wanted[0], wanted[1], path.display())]
    Size {
        /// What it has.
        found: [u32; 2],
        /// What is measured.
        wanted: [u32; 2],
        /// Where.
        path: PathBuf,
    },
    /// Its noise is unknown.
    #[error("the reference has no channel `{channel}`, so its noise is not known; make it by `weir render`: {}", path.display())]
    Channel {
        /// The channel.
        channel: &'static str,
        /// Where.
        path: PathBuf,
    },
    /// It could not be made.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl HasExit for JudgeError {
    fn exit(&self) -> Exit {
        match self {
            Self::Read(error) => error.exit(),
            Self::Size { .. } | Self::Channel { .. } => Exit::BadData,
            Self::Render(error) => error.exit(),
        }
    }
}

/// How a reference of the cache was made.
#[derive(Serialize, Deserialize)]
struct Made {
    integrator: String,
    time_s: f32,
}

/// The judge of a scene.
pub struct Judge {
    /// Its picture.
    pub picture: Picture,
    /// 1 / (r² + 0.01 m²) of each value.
    pub weights: Vec<f64>,
    /// Mean over all values.
    pub mean: f64,
    /// What is known of it.
    pub facts: ReferenceFacts,
}

impl Judge {
    fn new(picture: Picture, variance: &[[f32; 3]], samples: u32, integrator: &str, file: &Path) -> Self {
        let values = || picture.rgb.iter().flatten().map(|&v| f64::from(v));
        let n = values().count() as f64;
        let mean = values().sum::<f64>() / n;
        let weights = values().map(|r| 1.0 / (r * r + FLOOR * mean * mean).max(f64::MIN_POSITIVE)).collect();
        // Pixels of both integrators are independent of each other.
        let mean_variance = variance.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (n * n);
        let facts = ReferenceFacts {
            integrator: integrator.to_owned(),
            samples,
            rel_mse: noise_rel_mse(&picture, variance),
            mean_error: if mean > 0.0 { mean_variance.sqrt() / mean } else { 0.0 },
            file: file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        };
        Self { picture, weights, mean, facts }
    }

    /// Mean over values of their squares, each in relation to the reference.
    pub fn weighted(&self, squares: impl Iterator<Item = f64>) -> f64 {
        squares.zip(&self.weights).map(|(square, weight)| square * weight).sum::<f64>() / self.weights.len() as f64
    }

    /// Reads a file that `weir render` or [`Judge::get`] wrote.
    fn read(path: &Path, size: [u32; 2]) -> Result<(Self, f32), JudgeError> {
        let (picture, channels) = exr::read(path)?;
        let found = [picture.width, picture.height];
        if found != size {
            return Err(JudgeError::Size { found, wanted: size, path: path.to_owned() });
        }
        let lacks = |channel| JudgeError::Channel { channel, path: path.to_owned() };
        let samples_of = |name| channels.iter().find(|c| c.name == name).map(|c| &c.samples).ok_or_else(|| lacks(name));
        let floats = |name| match samples_of(name)? {
            Samples::Float(values) => Ok(values),
            Samples::Uint(_) => Err(lacks(name)),
        };
        let (r, g, b) = (floats("Variance.R")?, floats("Variance.G")?, floats("Variance.B")?);
        let Samples::Uint(samples) = samples_of("samples")? else { return Err(lacks("samples")) };
        let variance: Vec<[f32; 3]> = r.iter().zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b]).collect();
        let samples = samples.first().copied().unwrap_or(0);
        // Beside references of the cache stands how they were made.
        let made: Option<Made> =
            std::fs::read(path.with_extension("json")).ok().and_then(|b| serde_json::from_slice(&b).ok());
        let made = made.unwrap_or_else(|| Made { integrator: String::from("as given"), time_s: 0.0 });
        Ok((Self::new(picture, &variance, samples, &made.integrator, path), made.time_s))
    }

    /// The reference in `file`; or else the cached one of the same scene, view and size, if it was given nearly as much
    /// time; or else a new one, which is cached.
    ///
    /// # Errors
    /// If `file` can't be used, or rendering fails. A cache that can't be read or written is no error: it costs time.
    pub fn get(
        target: &Target,
        file: Option<&Path>,
        time: Duration,
        backend: &Backend<'_>,
        halt: &Halt<'_>,
    ) -> Result<Self, JudgeError> {
        let size = [target.width, target.height];
        if let Some(path) = file {
            return Ok(Self::read(path, size)?.0);
        }
        let kept = cache_path(target);
        match kept.as_ref().filter(|path| path.exists()).map(|path| Self::read(path, size)) {
            Some(Ok((judge, time_s))) if time_s >= GOOD_ENOUGH * time.as_secs_f32() => return Ok(judge),
            Some(Err(error)) => tracing::warn!("{error}; making another"),
            _ => {}
        }
        let (rendered, integrator) = make(target, time, backend, halt)?;
        let path = kept.clone().unwrap_or_default();
        let judge = Self::new(rendered.picture.clone(), &rendered.variance, rendered.samples, &integrator, &path);
        if let Some(path) = kept.filter(|_| halt.reason().is_none()) {
            keep(&path, target, &rendered, &integrator);
        }
        Ok(judge)
    }
}

/// Where the reference of this scene, view and size is kept; nowhere if the user has no folders.
fn cache_path(target: &Target) -> Option<PathBuf> {
    let folder = etcetera::choose_base_strategy().ok()?.cache_dir().join("weir").join("references");
    let mut hash = blake3::Hasher::new();
    let packed: &PackedScene = &target.packed;
    for part in crate::executor::SceneBuffers::NAMES {
        let bytes = packed.buffers().bytes(part);
        hash.update(part.as_bytes()).update(&(bytes.len() as u64).to_le_bytes()).update(bytes);
    }
    let camera = &target.camera;
    let view = [camera.origin, camera.target, camera.up].map(|v| v.to_array());
    hash.update(bytemuck::bytes_of(&view)).update(&camera.vfov_deg.to_le_bytes());
    hash.update(&target.width.to_le_bytes()).update(&target.height.to_le_bytes());
    // How it is made.
    hash.update(format!("{} {MOST_UNIFORM} {:?}", env!("CARGO_PKG_VERSION"), candidates().settings).as_bytes());
    let stem = target.name.replace(|c: char| !c.is_ascii_alphanumeric(), "-");
    Some(folder.join(format!("{stem}-{}x{}-{}.exr", target.width, target.height, &hash.finalize().to_hex()[..16])))
}

/// The candidates that make it where there are many lights.
fn candidates() -> Method {
    let knobs = ["candidates.count=16", "candidates.tree=12"];
    Method::new("candidates without reuse", Technique::Candidates, knobs).expect("knobs and values that exist")
}

/// What reuse does not touch: the reference integrator, or where there are many lights, candidates with neither neighbours
/// nor history.
fn make(
    target: &Target,
    time: Duration,
    backend: &Backend<'_>,
    halt: &Halt<'_>,
) -> Result<(Rendered, String), RenderError> {
    let method = candidates();
    let request = Request { seed: SEED, stop: Stop::Time(time), ..target.request(&method) };
    let go_on = |_| halt.reason().is_none();
    if target.packed.frame.light_count <= MOST_UNIFORM {
        Ok((render_reference(&target.packed, &request, go_on)?, String::from("the reference integrator")))
    } else {
        Ok((render(&target.packed, &request, backend, go_on)?, method.name))
    }
}

fn keep(path: &Path, target: &Target, rendered: &Rendered, integrator: &str) {
    let time_s = rendered.elapsed.as_secs_f32();
    let metadata = Metadata {
        render_time_s: Some(time_s),
        samples_per_pixel: Some(rendered.samples),
        seed: Some(u64::from(SEED)),
        ..Metadata::default()
    };
    let write = || -> Result<(), Box<dyn std::error::Error>> {
        path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        let layers = layers(&target.packed, &target.request(&candidates()), rendered)?;
        exr::write(&Destination::File(path.to_owned()), &rendered.picture, &layers, &metadata)?;
        let made = Made { integrator: integrator.to_owned(), time_s };
        Ok(atomic::write(&Destination::File(path.with_extension("json")), &serde_json::to_vec(&made)?)?)
    };
    if let Err(error) = write() {
        tracing::warn!("the reference is not kept for the next run: {error}");
    }
}
