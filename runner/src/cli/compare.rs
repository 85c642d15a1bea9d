//! `weir compare`.

use std::path::{Path, PathBuf};

use clap::Args;
use weir::{
    exit::{Exit, Usage},
    output::{
        Destination, Picture, atomic,
        compare::{CompareError, Comparison, compare, difference_picture, flip, noise_rel_mse, pixel_errors},
        exr::{self, Channel, Samples},
        png,
    },
    render::display_of,
    technique::ToneCurve,
};

#[derive(Debug, Args)]
pub struct CompareArguments {
    /// A picture: .exr, or .png, whose display-encoded values are compared as they are
    picture: PathBuf,
    /// What it is compared with
    reference: PathBuf,
    /// Largest difference of a pixel that is no failure
    #[arg(long, value_name = "DIFFERENCE", default_value_t = 1e-6)]
    fail: f64,
    /// Per cent of the pixels that may fail
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0)]
    fail_percent: f64,
    /// Difference of any pixel that is a failure
    #[arg(long, value_name = "DIFFERENCE")]
    hard_fail: Option<f64>,
    /// Largest difference of a pixel that is no warning
    #[arg(long, value_name = "DIFFERENCE", default_value_t = 1e-6)]
    warn: f64,
    /// Per cent of the pixels that may give a warning
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0)]
    warn_percent: f64,
    /// Difference of any pixel that is a warning
    #[arg(long, value_name = "DIFFERENCE")]
    hard_warn: Option<f64>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Draw where it is darker (blue) and brighter (red) than the reference: .png
    #[arg(long, value_name = "FILE")]
    difference: Option<PathBuf>,
    /// Relative difference that is saturated there, in per cent
    #[arg(long, value_name = "PERCENT", default_value_t = 10.0)]
    full_scale: f32,
}

/// A picture file.
struct File {
    picture: Picture,
    /// Squared standard errors, where they are known.
    variance: Option<Vec<[f32; 3]>>,
    /// As it is seen.
    display: Vec<u32>,
    is_linear: bool,
}

/// Runs `weir compare`: prints measures, and ends with the exit code of OpenImageIO's `idiff`.
pub fn run(arguments: &CompareArguments) -> anyhow::Result<Exit> {
    let limits = [arguments.fail, arguments.fail_percent, arguments.warn, arguments.warn_percent];
    let hard = [arguments.hard_fail, arguments.hard_warn].into_iter().flatten();
    if !limits.into_iter().chain(hard).all(|limit| limit >= 0.0) || !(arguments.full_scale > 0.0) {
        return Err(Usage(String::from("limits are numbers of 0 or above, and --full-scale is above 0")).into());
    }
    let [x, r] = match [read(&arguments.picture), read(&arguments.reference)] {
        [Ok(x), Ok(r)] if x.is_linear == r.is_linear => [x, r],
        [Ok(_), Ok(_)] => {
            eprintln!(
                "weir: one picture is linear and the other display-encoded; compare .exr with .exr, or .png with .png"
            );
            return Ok(Exit::FileError);
        }
        [Err(error), _] | [_, Err(error)] => {
            eprintln!("weir: {error:#}");
            return Ok(Exit::FileError);
        }
    };
    let found = match compare(&x.picture, &r.picture) {
        Ok(found) => found,
        Err(error) => {
            eprintln!("weir: {error}");
            let sizes_differ = matches!(error, CompareError::Size { .. });
            return Ok(if sizes_differ { Exit::SizesDiffer } else { Exit::DIFFERS });
        }
    };
    let verdict = judge(arguments, &pixel_errors(&x.picture, &r.picture));
    let flip = flip(r.picture.width, r.picture.height, &x.display, &r.display);
    let noise = r.variance.as_ref().map(|variance| noise_rel_mse(&r.picture, variance));
    super::print(&if arguments.json {
        as_json(&found, flip, noise, verdict)
    } else {
        as_text(&found, flip, noise, verdict)
    })?;
    if let Some(path) = &arguments.difference {
        let destination = Destination::from(path.clone());
        atomic::check(&destination)?;
        let drawn = difference_picture(&x.picture, &r.picture, arguments.full_scale / 100.0)?;
        png::write(&destination, r.picture.width, r.picture.height, &drawn)?;
    }
    Ok(verdict)
}

/// By the largest difference of each pixel; what is not finite in one picture alone fails.
fn judge(arguments: &CompareArguments, errors: &[f64]) -> Exit {
    let exceeds = |limit: f64, percent: f64, hard: Option<f64>| {
        let over = errors.iter().filter(|error| **error > limit).count() as f64;
        let largest = errors.iter().copied().fold(0.0, f64::max);
        over > percent / 100.0 * errors.len() as f64 || hard.is_some_and(|hard| largest > hard)
    };
    if exceeds(arguments.fail, arguments.fail_percent, arguments.hard_fail) {
        Exit::DIFFERS
    } else if exceeds(arguments.warn, arguments.warn_percent, arguments.hard_warn) {
        Exit::WARNS
    } else {
        Exit::Ok
    }
}

fn word(verdict: Exit) -> &'static str {
    match verdict {
        Exit::Ok => "same",
        Exit::WARNS => "warning",
        _ => "different",
    }
}

fn as_text(found: &Comparison, flip: Option<f64>, noise: Option<f64>, verdict: Exit) -> String {
    let mut text = format!("{found}\n");
    if let Some(noise) = noise {
        text += &format!("less noise      {:e} (relMSE less {noise:e}, the reference's own)\n", found.rel_mse - noise);
    }
    if let Some(flip) = flip {
        text += &format!("FLIP            {flip:.5}\n");
    }
    text + &format!("verdict         {}\n", word(verdict))
}

fn as_json(found: &Comparison, flip: Option<f64>, noise: Option<f64>, verdict: Exit) -> String {
    let value = serde_json::json!({
        "mean": found.mean, "reference_mean": found.reference_mean,
        "relative_mean_difference": found.relative_mean_difference(),
        "mse": found.mse, "rel_mse": found.rel_mse, "rel_mse_of_reference_noise": noise,
        "mape": found.mape, "smape": found.smape, "max_abs": found.max_abs, "flip": flip, "pixels": found.pixels,
        "non_finite": found.non_finite, "reference_non_finite": found.reference_non_finite, "verdict": word(verdict),
    });
    format!("{value:#}\n")
}

fn read(path: &Path) -> anyhow::Result<File> {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match extension.as_deref() {
        Some("exr") => {
            let (picture, channels) = exr::read(path)?;
            let shown = |rgb: &[f32; 3]| display_of((*rgb).into(), ToneCurve::default());
            let display = picture.rgb.iter().map(shown).collect();
            Ok(File { variance: variance_of(&channels), picture, display, is_linear: true })
        }
        Some("png") => {
            let named = |error: &dyn std::fmt::Display| {
                anyhow::anyhow!("cannot read the picture ({error}): {}", path.display())
            };
            let mut reader = image::ImageReader::open(path).map_err(|error| named(&error))?;
            reader.set_format(image::ImageFormat::Png);
            let decoded = reader.decode().map_err(|error| named(&error))?.into_rgb8();
            let (width, height) = decoded.dimensions();
            let display = decoded.pixels().map(|p| u32::from_le_bytes([p[0], p[1], p[2], 255])).collect();
            let rgb = decoded.pixels().map(|p| p.0.map(|v| f32::from(v) / 255.0)).collect();
            Ok(File { picture: Picture { width, height, rgb, alpha: None }, variance: None, display, is_linear: false })
        }
        _ => anyhow::bail!("pictures are .exr or .png: {}", path.display()),
    }
}

fn variance_of(channels: &[Channel]) -> Option<Vec<[f32; 3]>> {
    let of = |name: &str| {
        let channel = channels.iter().find(|channel| channel.name == name)?;
        if let Samples::Float(values) = &channel.samples { Some(values) } else { None }
    };
    let (r, g, b) = (of("Variance.R")?, of("Variance.G")?, of("Variance.B")?);
    Some(r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b]).collect())
}
